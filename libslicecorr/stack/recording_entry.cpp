// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "stack/recording_entry.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <iterator>

#include "slicecorr/error.hpp"
#include "slicecorr/units.hpp"
#include "stack/isa_l.hpp"
#include "support/text/csv.hpp"

namespace slicecorr {

std::span<const Recording::Showing> Recording::of(int slice) const {
  const auto n = static_cast<std::size_t>(slice);
  if (slice < 0 || n >= ends.size()) return {};
  const std::size_t begin = n ? ends[n - 1] : 0;
  return std::span(showings).subspan(begin, ends[n] - begin);
}

void Recording::add_slice(std::span<const Showing> shown) {
  showings.insert(showings.end(), shown.begin(), shown.end());
  ends.push_back(showings.size());
}

void check_recording(const Recording& recording, int images, const std::string& source) {
  if (recording.slices() > detail::kMaxRecordedSlices ||
      recording.showings.size() > static_cast<std::size_t>(detail::kMaxRecordedShowings)) {
    throw InputError(source, detail::kRecordingEntry,
                     fmt::format("has {} parts in {} slices; expected at most {} in {}",
                                 recording.showings.size(), recording.slices(),
                                 detail::kMaxRecordedShowings, detail::kMaxRecordedSlices));
  }
  // More than any print has, and small enough that sums of such numbers are finite.
  constexpr double most = 1e12;
  for (int n = 0; n < recording.slices(); ++n) {
    for (const Recording::Showing& p : recording.of(n)) {
      const auto wrong = [&](const std::string& what) {
        throw InputError(source, detail::kRecordingEntry, fmt::format("slice {}: {}", n, what));
      };
      if (p.image < -1 || p.image >= images) {
        wrong(fmt::format("image {}; expected -1 (black) to {}", p.image, images - 1));
      }
      const auto not_negative = [&](double value, const char* what) {
        if (!(value >= 0 && value <= most)) {
          wrong(fmt::format("{} {}; expected a number of at least 0", what, value));
        }
      };
      not_negative(p.light, "light");
      not_negative(p.uv_mw_cm2, "uv_mw_cm2");
      not_negative(p.blue_share, "blue_share");
      for (const double value : {p.from_um, p.to_um, p.speed_um_s}) {
        if (!(std::abs(value) <= most)) wrong("a place or speed that is no number");
      }
    }
  }
}

double planned_light_s(const Process& process, double layer_um, int slice, double m) {
  const double share = light_share(process, slice);
  const double counts = share == 1 ? 1 : std::pow(share, m);
  if (process.mode == ExposureMode::layerwise) return layer_exposure_s(process, slice) * counts;
  const bool stay = process.slice_lamps == SliceLamps::stay;
  return units::slice_time_s(slice_height_um(process, layer_um, slice),
                             stay ? slice_speed_mm_h(process, slice) : process.speed_mm_h) *
         counts;
}

double light_exponent(const Resin& resin, const Process& process) {
  return process.uv.kind != UvKind::off && resin.inhibition ? resin.inhibition->m : resin.m;
}

void refuse_recording(const SliceSource& source) {
  if (!source.recording()) return;
  throw InputError(
      "the stack is a recording of a print: its images are no slices; expected the stack of "
      "slices");
}

namespace detail {

namespace {

constexpr std::string_view kHead =
    "slice,image,light,uv_mw_cm2,from_um,to_um,speed_um_s,blue_share\n";
constexpr std::size_t kColumns = 8;

template <typename Number>
bool read_number(std::string_view text, Number& value) {
  const char* const end = text.data() + text.size();
  const auto [stop, error] = std::from_chars(text.data(), end, value);
  return error == std::errc{} && stop == end;
}

}  // namespace

std::string recording_csv(const Recording& recording) {
  std::string text(kHead);
  auto out = std::back_inserter(text);
  for (int n = 0; n < recording.slices(); ++n) {
    for (const Recording::Showing& p : recording.of(n)) {
      fmt::format_to(out, "{},{},{},{},{},{},{},{}\n", n, p.image, p.light, p.uv_mw_cm2, p.from_um,
                     p.to_um, p.speed_um_s, p.blue_share);
    }
  }
  return text;
}

std::uint32_t recording_crc32(std::string_view csv) {
  return isal::crc32(0, reinterpret_cast<const unsigned char*>(csv.data()), csv.size());
}

Recording parse_recording(std::string_view csv, int slices, const std::string& file) {
  Recording recording;
  int line = 1;
  const auto wrong = [&](const std::string& expected) {
    throw InputError(file, kRecordingEntry, fmt::format("line {}: expected {}", line, expected));
  };
  if (!csv.starts_with(kHead)) {
    wrong("the columns " + std::string(kHead.substr(0, kHead.size() - 1)));
  }
  csv.remove_prefix(kHead.size());
  const auto close_to = [&](int slice) {
    while (recording.slices() < slice) recording.ends.push_back(recording.showings.size());
  };
  while (!csv.empty()) {
    ++line;
    const std::size_t end = csv.find('\n');
    if (end == std::string_view::npos) wrong("a whole line");
    const std::vector<std::string_view> cell = comma_separated(csv.substr(0, end));
    csv.remove_prefix(end + 1);
    if (cell.size() != kColumns) wrong("8 columns");
    int slice = 0;
    Recording::Showing p;
    const bool read = read_number(cell[0], slice) && read_number(cell[1], p.image) &&
                      read_number(cell[2], p.light) && read_number(cell[3], p.uv_mw_cm2) &&
                      read_number(cell[4], p.from_um) && read_number(cell[5], p.to_um) &&
                      read_number(cell[6], p.speed_um_s) && read_number(cell[7], p.blue_share);
    if (!read) wrong("two whole numbers, then six numbers");
    if (slice >= slices) wrong(fmt::format("a slice below {}, of which there are", slices));
    if (slice < recording.slices()) wrong("slices that rise");
    close_to(slice);
    recording.showings.push_back(p);
  }
  close_to(slices);
  return recording;
}

void add_recording(const StackInfo& info, ContainerOutput& output) {
  if (info.recording) output.add_text(kRecordingEntry, recording_csv(*info.recording));
}

void read_recording(const Container& archive, ArchiveContents& contents) {
  if (!contents.recording) return;
  const RecordingFacts& facts = *contents.recording;
  if (archive.find(kRecordingEntry) == nullptr) {
    throw InputError(archive.path(), kRecordingEntry, "is missing");
  }
  // A row is two whole numbers and six of at most 24 digits.
  const std::string csv =
      archive.text(kRecordingEntry, 4096 + 200 * static_cast<std::uint64_t>(facts.showings));
  if (recording_crc32(csv) != facts.crc32) {
    throw InputError(archive.path(), kRecordingEntry,
                     "is damaged: it is not what the recording's block says");
  }
  Recording recording = parse_recording(csv, facts.slices, archive.path());
  recording.other_uv_images = facts.other_uv_images;
  check_recording(recording, contents.info.grid.layers, archive.path());
  contents.info.recording = std::make_shared<const Recording>(std::move(recording));
}

}  // namespace detail

}  // namespace slicecorr
