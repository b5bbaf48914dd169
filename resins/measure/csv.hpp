/// @file csv.hpp
/// Lines and fields of tables of text, in bounded memory.
///
/// Lines end with LF, CRLF or CR. Fields are separated by commas, may stand in double quotes, and
/// are given without quotes and surrounding blanks. `#` outside of quotes starts a comment. Errors
/// are `InputError`s with file and line.
#pragma once

#include <cstdio>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

namespace slicecorr::resins {

/// The lines of a file or text, one after the other; a byte order mark is passed over.
class LineReader {
 public:
  /// Opens a file; throws `InputError` when it can't be read.
  static LineReader of_file(const std::string& path);
  static LineReader of_text(std::string_view text, const std::string& source);

  /// Gives the next line, valid until the next call; false at the end.
  bool next(std::string_view& line);
  /// Number of the line that `next` gave, from 1.
  int number() const { return number_; }
  const std::string& source() const { return source_; }
  /// "line N" of the present line.
  std::string place() const;

 private:
  explicit LineReader(std::string source) : source_(std::move(source)) {}
  /// Drops what was given, and reads on.
  void fill();

  struct Close {
    void operator()(std::FILE* file) const { std::fclose(file); }
  };
  std::string source_;
  std::unique_ptr<std::FILE, Close> file_;
  std::string buffer_;
  std::size_t at_ = 0;
  bool ended_ = false, begun_ = false;
  int number_ = 0;
};

/// Splits a line; no fields when it is blank or holds a comment only. Views into the line.
void split_fields(std::string_view line, const LineReader& reader,
                  std::vector<std::string_view>& fields);

/// A field as it may stand in a message: short, on one line, printable.
std::string shown(std::string_view field);

}  // namespace slicecorr::resins
