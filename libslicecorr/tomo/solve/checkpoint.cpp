// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "tomo/solve/checkpoint.hpp"

#include <fmt/format.h>

#include <array>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <memory>
#include <type_traits>

#include "slicecorr/error.hpp"
#include "support/files/temporary.hpp"

namespace slicecorr::tomo::detail {

namespace {

constexpr std::array<char, 24> kMagic{"slicecorr tomo solve 4\n"};

struct CloseFile {
  void operator()(std::FILE* file) const { std::fclose(file); }
};
using File = std::unique_ptr<std::FILE, CloseFile>;

/// Both ways through the same fields: `in.field(x)` reads or writes and hashes it.
class Writer {
 public:
  Writer(std::FILE* file, const std::string& path) : file_(file), path_(path) {}
  template <class T>
  void field(const T& value) {
    static_assert(std::is_trivially_copyable_v<T>);
    bytes(&value, sizeof value);
  }
  void numbers(const Array<float>& values) {
    field(static_cast<std::uint64_t>(values.size()));
    bytes(values.data(), values.size() * sizeof(float));
  }
  template <class T>
  void some(const std::vector<T>& values) {
    field(static_cast<std::uint64_t>(values.size()));
    for (const T& value : values) field(value);
  }
  std::uint64_t hash() const { return hash_; }

 private:
  void bytes(const void* data, std::size_t size) {
    hash_ = hash_of(data, size, hash_);
    if (size > 0 && std::fwrite(data, 1, size, file_) != size) {
      throw DeviceError(fmt::format("{}: can't be written: {}", path_, std::strerror(errno)));
    }
  }
  std::FILE* file_;
  const std::string& path_;
  std::uint64_t hash_ = hash_of(nullptr, 0);
};

class Reader {
 public:
  Reader(std::FILE* file, const std::string& path) : file_(file), path_(path) {}
  template <class T>
  void field(T& value) {
    static_assert(std::is_trivially_copyable_v<T>);
    bytes(&value, sizeof value);
  }
  void numbers(Array<float>& values, std::size_t count) {
    std::uint64_t size = 0;
    field(size);
    if (size != count) damaged();
    values.resize(count);
    bytes(values.data(), count * sizeof(float));
  }
  /// No more than a few for each slice.
  template <class T>
  void some(std::vector<T>& values) {
    std::uint64_t size = 0;
    field(size);
    if (size > 100000000) damaged();
    values.resize(size);
    for (T& value : values) field(value);
  }
  std::uint64_t hash() const { return hash_; }
  bool at_end() { return std::fgetc(file_) == EOF; }
  [[noreturn]] void damaged() const {
    throw InputError(path_, "",
                     "is damaged; expected what a solve left; a solve that does not go on "
                     "from it starts anew");
  }

 private:
  void bytes(void* data, std::size_t size) {
    if (size > 0 && std::fread(data, 1, size, file_) != size) damaged();
    hash_ = hash_of(data, size, hash_);
  }
  std::FILE* file_;
  const std::string& path_;
  std::uint64_t hash_ = hash_of(nullptr, 0);
};

template <class Place, class File>
void scalars(Place& place, File& file) {
  file.field(place.rung);
  file.field(place.step);
  file.field(place.best.rung);
  file.field(place.best.contrast_bound);
  file.field(place.best.bound_slice);
}

template <class Value, class File>
void step_of(Value& step, File& file) {
  file.field(step.rung);
  file.field(step.step);
  file.field(step.loss);
  file.field(step.ver);
  file.field(step.pw);
  file.field(step.contrast);
}

}  // namespace

std::uint64_t hash_of(const void* data, std::size_t size, std::uint64_t before) {
  const auto* const bytes = static_cast<const unsigned char*>(data);
  for (std::size_t i = 0; i < size; ++i) before = (before ^ bytes[i]) * 0x100000001b3U;
  return before;
}

std::uint64_t hash_of(const SolveOptions& o) {
  std::uint64_t hash = hash_of(nullptr, 0);
  const auto add = [&](double value) { hash = hash_of(&value, sizeof value, hash); };
  for (const double value :
       {static_cast<double>(o.method), static_cast<double>(o.window.kind), o.window.k0,
        1.0 * o.steps, 1.0 * o.most_steps, o.most_dose, o.cap, 1.0 * o.memory, 1.0 * o.proof_steps,
        o.osmo_high, o.osmo_low, o.clip_sigma, o.stop_error}) {
    add(value);
  }
  for (const double rung : o.rungs) add(rung);
  if (o.start != nullptr) {
    hash = hash_of(o.start->data(), o.start->size() * sizeof(float), hash);
  }
  return hash;
}

CheckpointFile::CheckpointFile(std::string path, double every_s, const Fingerprint& fingerprint)
    : path_(std::move(path)),
      fingerprint_(fingerprint),
      every_(std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(every_s))),
      not_before_(Clock::now() + every_) {}

std::optional<SolverState> CheckpointFile::read(const Shape& shape) {
  if (path_.empty() || !std::filesystem::exists(path_)) return std::nullopt;
  const File file(std::fopen(path_.c_str(), "rb"));
  if (!file) throw InputError(path_, "", std::string("can't be read: ") + std::strerror(errno));
  Reader in(file.get(), path_);
  std::array<char, kMagic.size()> magic{};
  in.field(magic);
  if (magic != kMagic) in.damaged();
  Fingerprint found;
  in.field(found);
  const char* const other = found.part != fingerprint_.part       ? "another part"
                            : found.insert != fingerprint_.insert ? "another insert"
                            : found.machine != fingerprint_.machine
                                ? "another printer, resin, number of angles or size of voxels"
                            : found.options != fingerprint_.options ? "other options"
                                                                    : nullptr;
  if (other != nullptr) {
    throw InputError(path_, "",
                     fmt::format("is of a solve with {}; expected the same as before; "
                                 "a solve that does not go on from it starts anew",
                                 other));
  }
  int attempt = 0;
  in.field(attempt);
  if (attempt < 0 || attempt > 1) in.damaged();
  std::vector<int> passes;
  in.some(passes);
  SolverState state;
  scalars(state, in);
  in.some(state.of_slices);
  in.some(state.missed);
  std::uint64_t steps = 0, model = 0;
  in.field(steps);
  if (steps > 100000000) in.damaged();
  state.best.history.resize(steps);
  for (Step& step : state.best.history) step_of(step, in);
  in.field(model);
  in.numbers(state.numbers, model != 0 ? shape.field() : shape.light());
  std::uint64_t dose = 0;
  in.field(dose);
  in.numbers(state.dose, dose != 0 ? shape.field() : 0);
  in.numbers(state.best.light, shape.light());
  in.field(dose);
  in.numbers(state.best.dose, dose != 0 ? shape.field() : 0);
  const std::uint64_t hash = in.hash();
  std::uint64_t written = 0;
  in.field(written);
  if (written != hash || !in.at_end()) in.damaged();
  passes_ = std::move(passes);
  attempt_ = attempt;
  return state;
}

void CheckpointFile::keep(const SolverPlace& place) {
  const auto before = Clock::now();
  if (path_.empty() || before < not_before_) return;
  slicecorr::detail::Temporary temporary{slicecorr::detail::make_temporary(path_)};
  const auto failed = [&] {
    throw DeviceError(fmt::format("{}: can't be written: {}", path_, std::strerror(errno)));
  };
  File file(std::fopen(temporary.path.c_str(), "wb"));
  if (!file) failed();
  Writer out(file.get(), path_);
  out.field(kMagic);
  out.field(fingerprint_);
  out.field(attempt_);
  out.some(passes_);
  scalars(place, out);
  out.some(place.of_slices);
  out.some(place.missed);
  out.field(static_cast<std::uint64_t>(place.best.history.size()));
  for (const Step& step : place.best.history) step_of(step, out);
  out.field(std::uint64_t{place.numbers.size() != place.best.light.size()});
  out.numbers(place.numbers);
  out.field(std::uint64_t{!place.dose.empty()});
  out.numbers(place.dose);
  out.numbers(place.best.light);
  out.field(std::uint64_t{!place.best.dose.empty()});
  out.numbers(place.best.dose);
  const std::uint64_t hash = out.hash();
  out.field(hash);
  if (std::fclose(file.release()) != 0) failed();
  slicecorr::detail::put_in_place(temporary, path_);
  const auto now = Clock::now();
  not_before_ = now + std::max(every_, 20 * (now - before));
}

}  // namespace slicecorr::tomo::detail
