#include "measure/csv.hpp"

#include <fmt/format.h>
#include <sys/stat.h>

#include <algorithm>
#include <cerrno>
#include <cstring>

#include "slicecorr/error.hpp"
#include "support/text/ascii.hpp"

namespace slicecorr::resins {

namespace {

constexpr std::size_t kChunkBytes = std::size_t{1} << 18;
// No row of measurements comes near; a file without line ends must not fill the memory.
constexpr std::size_t kLongestLine = std::size_t{1} << 16;

}  // namespace

LineReader LineReader::of_file(const std::string& path) {
  LineReader reader(path);
  reader.file_.reset(std::fopen(path.c_str(), "rb"));
  struct stat status {};
  if (reader.file_ && ::fstat(fileno(reader.file_.get()), &status) == 0 &&
      S_ISDIR(status.st_mode)) {
    throw InputError(path, "", "is a folder; expected a CSV file of measurements");
  }
  if (!reader.file_) {
    throw InputError(path, "", fmt::format("can't be read: {}", std::strerror(errno)));
  }
  return reader;
}

LineReader LineReader::of_text(std::string_view text, const std::string& source) {
  LineReader reader(source);
  reader.buffer_ = text;
  reader.ended_ = true;
  return reader;
}

std::string LineReader::place() const { return fmt::format("line {}", number_); }

void LineReader::fill() {
  if (ended_) return;
  buffer_.erase(0, at_);
  at_ = 0;
  const std::size_t kept = buffer_.size();
  buffer_.resize(kept + kChunkBytes);
  const std::size_t n = std::fread(buffer_.data() + kept, 1, kChunkBytes, file_.get());
  buffer_.resize(kept + n);
  if (n < kChunkBytes) {
    if (std::ferror(file_.get())) {
      throw DeviceError(fmt::format("{}: reading failed: {}", source_, std::strerror(errno)));
    }
    ended_ = true;
  }
}

bool LineReader::next(std::string_view& line) {
  if (!begun_) {
    begun_ = true;
    fill();
    const std::string_view head(buffer_);
    const auto begins = [&](std::string_view mark) { return head.substr(0, mark.size()) == mark; };
    if (begins("\xEF\xBB\xBF")) at_ = 3;
    if (begins("\xFF\xFE") || begins("\xFE\xFF")) {
      throw InputError(source_, "line 1", "is UTF-16 text; save it as CSV in UTF-8");
    }
    if (begins("PK\x03\x04")) {
      throw InputError(source_, "line 1",
                       "is a zip archive or a workbook; export the sheet as CSV");
    }
  }
  std::size_t from = at_, end = 0;
  while (true) {
    end = buffer_.find_first_of("\r\n", from);
    // What follows a CR must be known before its line ends.
    const bool found =
        end != std::string::npos && (buffer_[end] == '\n' || end + 1 < buffer_.size() || ended_);
    if (found || ended_ || buffer_.size() - at_ > kLongestLine) break;
    from = (end == std::string::npos ? buffer_.size() : end) - at_;
    fill();
  }
  if (end == std::string::npos) end = buffer_.size();
  if (at_ == buffer_.size()) return false;
  ++number_;
  if (end - at_ > kLongestLine) {
    throw InputError(
        source_, place(),
        fmt::format("is longer than {} bytes; expected a row of measurements", kLongestLine));
  }
  line = std::string_view(buffer_).substr(at_, end - at_);
  at_ = end;
  if (at_ < buffer_.size()) {
    const bool pair = buffer_[at_] == '\r' && at_ + 1 < buffer_.size() && buffer_[at_ + 1] == '\n';
    at_ += pair ? 2 : 1;
  }
  return true;
}

void split_fields(std::string_view line, const LineReader& reader,
                  std::vector<std::string_view>& fields) {
  fields.clear();
  std::size_t at = 0;
  bool any = false;
  while (true) {
    while (at < line.size() && (line[at] == ' ' || line[at] == '\t')) ++at;
    const bool quoted = at < line.size() && line[at] == '"';
    std::string_view field;
    if (quoted) {
      const std::size_t begin = ++at;
      // Two quotes in a row stand for one; no number has any, so they stay as they are.
      while (at < line.size() &&
             (line[at] != '"' || (at + 1 < line.size() && line[at + 1] == '"'))) {
        at += line[at] == '"' ? 2 : 1;
      }
      if (at >= line.size()) {
        throw InputError(reader.source(), reader.place(),
                         fmt::format("the quote before '{}' is not closed on its line",
                                     shown(line.substr(begin))));
      }
      field = trimmed(line.substr(begin, at - begin));
      ++at;
      while (at < line.size() && (line[at] == ' ' || line[at] == '\t')) ++at;
      if (at < line.size() && line[at] != ',' && line[at] != '#') {
        throw InputError(
            reader.source(), reader.place(),
            fmt::format("'{}' follows a closing quote; expected a comma", shown(line.substr(at))));
      }
      any = true;
    } else {
      const std::size_t begin = at;
      while (at < line.size() && line[at] != ',' && line[at] != '#') {
        const auto c = static_cast<unsigned char>(line[at]);
        if ((c < 0x20 && c != '\t') || c == 0x7F) {
          throw InputError(reader.source(), reader.place(),
                           fmt::format("holds a byte that is no text (0x{:02x}); expected a CSV "
                                       "file of measurements",
                                       c));
        }
        ++at;
      }
      field = trimmed(line.substr(begin, at - begin));
    }
    any = any || !field.empty();
    fields.push_back(field);
    if (at >= line.size() || line[at] == '#') break;
    ++at;
  }
  // Spreadsheets write empty rows as commas alone.
  if (!any) fields.clear();
}

std::string shown(std::string_view field) {
  constexpr std::size_t longest = 40;
  std::string text(field.substr(0, longest));
  std::replace_if(
      text.begin(), text.end(), [](char c) { return c < 0x20 || c == 0x7F; }, '?');
  return field.size() > longest ? text + "..." : text;
}

}  // namespace slicecorr::resins
