// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "support/numpy/npy_input.hpp"

#include <fmt/format.h>

#include <bit>
#include <charconv>
#include <string_view>
#include <system_error>

#include "slicecorr/error.hpp"
#include "support/files/errno_message.hpp"

namespace slicecorr::detail {

namespace {

static_assert(std::endian::native == std::endian::little);

constexpr std::size_t kLongestHeader = 1 << 16;

std::size_t byte(char c) { return static_cast<unsigned char>(c); }

/// Reads the dictionary of a header: a literal of Python with just these three keys.
class HeaderReader {
 public:
  HeaderReader(const std::string& file, std::string_view text) : file_(file), text_(text) {}

  NpyHeader read() {
    NpyHeader header;
    bool type = false, order = false, shape = false;
    expect('{');
    while (!accept('}')) {
      const std::string key = quoted();
      expect(':');
      if (key == "descr" && !type) {
        header.type = quoted();
        type = true;
      } else if (key == "fortran_order" && !order) {
        header.fortran = truth();
        order = true;
      } else if (key == "shape" && !shape) {
        header.shape = tuple();
        shape = true;
      } else {
        wrong();
      }
      if (accept('}')) break;
      expect(',');
    }
    skip();
    if (at_ != text_.size() || !type || !order || !shape) wrong();
    return header;
  }

 private:
  [[noreturn]] void wrong() const {
    throw InputError(file_, "header",
                     "can't be read; expected an array as numpy.save writes it, of one type");
  }
  void skip() {
    while (at_ < text_.size() && (text_[at_] == ' ' || text_[at_] == '\n')) ++at_;
  }
  bool accept(char c) {
    skip();
    if (at_ >= text_.size() || text_[at_] != c) return false;
    ++at_;
    return true;
  }
  void expect(char c) {
    if (!accept(c)) wrong();
  }
  std::string quoted() {
    skip();
    if (at_ >= text_.size() || (text_[at_] != '\'' && text_[at_] != '"')) wrong();
    const char quote = text_[at_++];
    const std::size_t end = text_.find(quote, at_);
    if (end == std::string_view::npos) wrong();
    std::string word(text_.substr(at_, end - at_));
    at_ = end + 1;
    return word;
  }
  bool truth() {
    skip();
    for (const bool value : {false, true}) {
      const std::string_view word = value ? "True" : "False";
      if (text_.substr(at_).starts_with(word)) {
        at_ += word.size();
        return value;
      }
    }
    wrong();
  }
  std::vector<std::size_t> tuple() {
    std::vector<std::size_t> numbers;
    expect('(');
    while (!accept(')')) {
      skip();
      std::size_t value = 0;
      const char* const from = text_.data() + at_;
      const auto [stop, error] = std::from_chars(from, text_.data() + text_.size(), value);
      if (error != std::errc{}) wrong();
      at_ += static_cast<std::size_t>(stop - from);
      numbers.push_back(value);
      if (accept(')')) break;
      expect(',');
    }
    return numbers;
  }

  const std::string& file_;
  std::string_view text_;
  std::size_t at_ = 0;
};

}  // namespace

NpyInput::NpyInput(const std::string& path) : path_(path), file_(path, std::ios::binary) {
  if (!file_) throw InputError(errno_message(path, "can't be read"));
  std::string start(10, '\0');
  take(start.data(), start.size());
  if (!std::string_view(start).starts_with(kNpyMagic)) {
    throw InputError(path, "", "is no file of NumPy; expected one that numpy.save wrote (.npy)");
  }
  const int version = static_cast<unsigned char>(start[6]);
  if (version < 1 || version > 3) {
    throw InputError(path, "header",
                     fmt::format("has version {}; this program knows 1 to 3", version));
  }
  std::size_t size = byte(start[8]) | byte(start[9]) << 8;
  if (version >= 2) {
    char more[2];
    take(more, 2);
    size |= byte(more[0]) << 16 | byte(more[1]) << 24;
  }
  if (size > kLongestHeader) throw InputError(path, "header", "is too long");
  std::string text(size, '\0');
  take(text.data(), size);
  header_ = HeaderReader(path, text).read();
}

void NpyInput::wrong(const std::string& what) const { throw InputError(path_, "", what); }

std::array<int, 3> NpyInput::size(const NpyBounds& bounds) const {
  const auto& s = header_.shape;
  std::string words;
  for (const std::size_t n : s) words += fmt::format("{}{}", words.empty() ? "" : " x ", n);
  if (s.size() != 3 && s.size() != 2) {
    wrong(fmt::format("has {} axes; expected (z, y, x), or (y, x) for one slice", s.size()));
  }
  if (header_.fortran) {
    wrong("is in Fortran's order; expected C order: save numpy.ascontiguousarray of it");
  }
  std::size_t all = 1;
  for (const std::size_t n : s) {
    if (n < 1 || n > bounds.along_axis) {
      wrong(fmt::format("is {}; expected 1 to {} along each axis", words, bounds.along_axis));
    }
    all *= n;
  }
  if (all > bounds.in_all) wrong(fmt::format("is {}, too large", words));
  return {s.size() == 3 ? static_cast<int>(s[0]) : 1, static_cast<int>(s[s.size() - 2]),
          static_cast<int>(s.back())};
}

void NpyInput::finish() {
  if (file_.peek() != std::char_traits<char>::eof()) {
    wrong("holds more than its header says; expected one array");
  }
}

void NpyInput::take(char* out, std::size_t size) {
  file_.read(out, static_cast<std::streamsize>(size));
  if (static_cast<std::size_t>(file_.gcount()) != size) {
    wrong("ends too early; expected all numbers that its header says");
  }
}

}  // namespace slicecorr::detail
