// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/tomo/npy.hpp"

#include <fmt/format.h>

#include <bit>
#include <cerrno>
#include <charconv>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <limits>
#include <memory>
#include <optional>
#include <string_view>
#include <system_error>

#include "slicecorr/error.hpp"
#include "support/files/errno_message.hpp"
#include "support/files/temporary.hpp"

namespace slicecorr::tomo {

namespace {

static_assert(std::endian::native == std::endian::little);

constexpr std::string_view kMagic = "\x93NUMPY";
constexpr std::size_t kLongestHeader = 1 << 16;

/// What the header says of the array.
struct Header {
  std::string type;
  bool fortran = false;
  std::vector<std::size_t> shape;
};

/// Reads the dictionary of a header: a literal of Python with just these three keys.
class HeaderReader {
 public:
  HeaderReader(const std::string& file, std::string_view text) : file_(file), text_(text) {}

  Header read() {
    Header header;
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

/// A file of NumPy up to its numbers.
class Input {
 public:
  explicit Input(const std::string& path) : path_(path), file_(path, std::ios::binary) {
    if (!file_) throw InputError(slicecorr::detail::errno_message(path, "can't be read"));
    std::string start(10, '\0');
    take(start.data(), start.size());
    if (!std::string_view(start).starts_with(kMagic)) {
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

  const Header& header() const { return header_; }
  [[noreturn]] void wrong(const std::string& what) const { throw InputError(path_, "", what); }

  /// The size of `box`, checked.
  template <class T>
  void shape(Box<T>& box) const {
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
      if (n < 1 || n > kMostAlongAxis) {
        wrong(fmt::format("is {}; expected 1 to {} along each axis", words, kMostAlongAxis));
      }
      all *= n;
    }
    if (all > kMostInBox) wrong(fmt::format("is {}, too large", words));
    box.nz = s.size() == 3 ? static_cast<int>(s[0]) : 1;
    box.ny = static_cast<int>(s[s.size() - 2]);
    box.nx = static_cast<int>(s.back());
    box.values.resize(all);
  }
  template <class T>
  void numbers(T* out, std::size_t count) {
    take(reinterpret_cast<char*>(out), count * sizeof(T));
  }
  void finish() {
    if (file_.peek() != std::char_traits<char>::eof()) {
      wrong("holds more than its header says; expected one array");
    }
  }

 private:
  static std::size_t byte(char c) { return static_cast<unsigned char>(c); }
  void take(char* out, std::size_t size) {
    file_.read(out, static_cast<std::streamsize>(size));
    if (static_cast<std::size_t>(file_.gcount()) != size) {
      wrong("ends too early; expected all numbers that its header says");
    }
  }

  const std::string& path_;
  std::ifstream file_;
  Header header_;
};

template <class T>
void write(const std::string& path, const char* type, const Box<T>& box) {
  std::string header =
      fmt::format("{{'descr': '{}', 'fortran_order': False, 'shape': ({}, {}, {}), }}", type,
                  box.nz, box.ny, box.nx);
  // The numbers begin at a multiple of 64 bytes.
  constexpr std::size_t start = 10, line = 64;
  header.resize((start + header.size() + 1 + line - 1) / line * line - start - 1, ' ');
  header += '\n';
  std::string head(kMagic);
  head += '\1';
  head += '\0';
  head += static_cast<char>(header.size() & 0xFF);
  head += static_cast<char>(header.size() >> 8);
  slicecorr::detail::Temporary temporary{slicecorr::detail::make_temporary(path)};
  std::ofstream out(temporary.path, std::ios::binary);
  out << head << header;
  out.write(reinterpret_cast<const char*>(box.values.data()),
            static_cast<std::streamsize>(box.values.size() * sizeof(T)));
  out.close();
  if (!out) throw DeviceError(slicecorr::detail::errno_message(path, "can't be written"));
  slicecorr::detail::put_in_place(temporary, path);
}

}  // namespace

Box<std::uint8_t> read_part_npy(const std::string& path) {
  Input in(path);
  const std::string& type = in.header().type;
  const bool truth = type == "|b1";
  if (type != "|u1" && !truth) {
    in.wrong(fmt::format("holds '{}'; expected unsigned bytes (255 part, 0 empty), or truth values",
                         type));
  }
  Box<std::uint8_t> box;
  in.shape(box);
  in.numbers(box.values.data(), box.values.size());
  in.finish();
  if (truth) {
    for (std::uint8_t& v : box.values) v = v != 0 ? 255 : 0;
  }
  return box;
}

Box<float> read_dose_npy(const std::string& path) {
  Input in(path);
  const std::string& type = in.header().type;
  Box<float> box;
  in.shape(box);
  if (type == "<f4") {
    in.numbers(box.values.data(), box.values.size());
  } else if (type == "<f8") {
    std::vector<double> row(static_cast<std::size_t>(box.nx));
    for (std::size_t at = 0; at < box.values.size(); at += row.size()) {
      in.numbers(row.data(), row.size());
      for (std::size_t i = 0; i < row.size(); ++i) box.values[at + i] = static_cast<float>(row[i]);
    }
  } else {
    in.wrong(fmt::format("holds '{}'; expected numbers of 32 bits, '<f4'", type));
  }
  in.finish();
  for (std::size_t i = 0; i < box.values.size(); ++i) {
    if (std::isfinite(box.values[i])) continue;
    in.wrong(fmt::format("number {} is not finite", i));
  }
  return box;
}

void write_npy(const std::string& path, const Box<std::uint8_t>& box) { write(path, "|u1", box); }
void write_npy(const std::string& path, const Box<float>& box) { write(path, "<f4", box); }

}  // namespace slicecorr::tomo
