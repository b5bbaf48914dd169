// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "stack/formats/layer_gcode.hpp"

#include <algorithm>
#include <charconv>
#include <cmath>

#include "slicecorr/error.hpp"
#include "stack/formats/archive_format.hpp"
#include "support/text/ascii.hpp"

namespace slicecorr::detail {
namespace {

constexpr std::string_view kBlanks = " \t\r";

std::size_t line_end(std::string_view text, std::size_t begin) {
  return std::min(text.find('\n', begin), text.size());
}

/// Start of the line before the one that starts at `begin`, which is not the first.
std::size_t line_before(std::string_view text, std::size_t begin) {
  const std::size_t end = begin >= 2 ? text.rfind('\n', begin - 2) : text.npos;
  return end == text.npos ? 0 : end + 1;
}

std::string_view line_at(std::string_view text, std::size_t begin) {
  return text.substr(begin, line_end(text, begin) - begin);
}

/// Start of the line after the one at `begin`.
std::size_t next_line(std::string_view text, std::size_t begin) {
  return std::min(line_end(text, begin) + 1, text.size());
}

std::string_view without_indent(std::string_view line) {
  const std::size_t first = line.find_first_not_of(kBlanks);
  return first == line.npos ? std::string_view{} : line.substr(first);
}

/// A number written in the text.
struct Token {
  std::size_t begin = 0, end = 0;
  double value = 0;
  int decimals = 0;
};

/// Number that starts at `at`, which may have a sign and a fraction.
std::optional<Token> number_at(std::string_view text, std::size_t at) {
  Token t{at, at, 0, 0};
  if (t.end < text.size() && (text[t.end] == '-' || text[t.end] == '+')) ++t.end;
  const std::size_t digits = t.end;
  while (t.end < text.size() && is_digit(text[t.end])) ++t.end;
  std::size_t count = t.end - digits;
  // "1.png" has no fraction.
  if (t.end + 1 < text.size() && text[t.end] == '.' && is_digit(text[t.end + 1])) {
    const std::size_t point = t.end++;
    while (t.end < text.size() && is_digit(text[t.end])) ++t.end;
    t.decimals = static_cast<int>(t.end - point - 1);
    count += t.end - point - 1;
  }
  if (count == 0 || count > 30) return std::nullopt;
  const std::size_t first = text[at] == '+' ? at + 1 : at;
  const auto [end, error] = std::from_chars(text.data() + first, text.data() + t.end, t.value);
  (void)end;
  if (error != std::errc()) return std::nullopt;
  return t;
}

/// The number at `at`, unless what follows could be a part of it, like an exponent or "_000".
std::optional<Token> plain_number(std::string_view text, std::size_t at) {
  auto token = at < text.size() ? number_at(text, at) : std::nullopt;
  if (!token) return std::nullopt;
  std::size_t end = token->end;
  // "4000." is a number, too.
  if (end < text.size() && text[end] == '.') ++end;
  const bool ends = end >= text.size() || kBlanks.find(text[end]) != kBlanks.npos;
  const std::size_t next = text.find_first_not_of(kBlanks, end);
  if (!ends || (next != text.npos && is_digit(text[next]))) return std::nullopt;
  token->end = end;
  return token;
}

/// All numbers of a line.
std::vector<Token> numbers_of(std::string_view text, std::size_t begin, std::size_t end) {
  std::vector<Token> found;
  for (std::size_t i = begin; i < end;) {
    const auto token = is_digit(text[i]) ? number_at(text.substr(0, end), i) : std::nullopt;
    if (token) found.push_back(*token);
    i = token ? token->end : i + 1;
  }
  return found;
}

/// Number after the letter `word` of a G-code line ("Z" in "G0 Z6.1 F120"), before its comment.
std::optional<Token> word_of(std::string_view text, std::size_t begin, char word) {
  const std::size_t end = std::min(text.find(';', begin), line_end(text, begin));
  for (std::size_t i = begin; i + 1 < end; ++i) {
    if (text[i] == word && i > begin && kBlanks.find(text[i - 1]) != kBlanks.npos) {
      return number_at(text.substr(0, end), i + 1);
    }
  }
  return std::nullopt;
}

/// Whether two lines are alike but for their numbers.
bool alike(std::string_view a, std::string_view b) {
  const auto in_number = [](char c) { return is_digit(c) || c == '.' || c == '-'; };
  std::size_t i = 0, j = 0;
  while (i < a.size() && j < b.size()) {
    if (in_number(a[i]) && in_number(b[j])) {
      while (i < a.size() && in_number(a[i])) ++i;
      while (j < b.size() && in_number(b[j])) ++j;
    } else if (a[i++] != b[j++]) {
      return false;
    }
  }
  return i == a.size() && j == b.size();
}

bool is_move(std::string_view line) {
  return line.starts_with("G0 ") || line.starts_with("G1 ") || line.starts_with("G00 ") ||
         line.starts_with("G01 ");
}

/// Whether two times are the same to the millisecond: such a time stays as it is written.
bool is_same(double a_s, double b_s) { return std::abs(a_s - b_s) < 0.0005; }

}  // namespace

std::size_t end_of_head(std::string_view text) {
  std::size_t at = 0;
  while (at < text.size()) {
    const std::size_t first = text.find_first_not_of(" \t\r\n", at);
    // ";<Slice>" is a command.
    if (first == text.npos || text[first] != ';' || text.substr(first, 2) == ";<") break;
    at = next_line(text, first);
  }
  return at;
}

LayerGcode::LayerGcode(std::string text, const GcodeDialect& dialect, std::string file,
                       std::string entry)
    : text_(std::move(text)), file_(std::move(file)), entry_(std::move(entry)), dialect_(dialect) {
  const std::string_view all = text_;
  bool showing = false, lit = false, done = false, switched = false;
  bool to_place = true;  // moves go to a place, not by a way
  double z_mm = 0;
  // Places of the layer at hand, and how many the one before has.
  std::vector<double> stops_mm;
  std::size_t stops_before = 0;
  for (std::size_t begin = 0; begin < all.size(); begin = next_line(all, begin)) {
    const std::string_view line = without_indent(line_at(all, begin));
    if (line.empty()) continue;
    if (layers_.empty() && line.starts_with("G91")) absolute_ = false;
    if (layers_.empty() && line.starts_with("G90")) absolute_ = true;
    const auto at = static_cast<std::size_t>(line.data() - all.data());
    if (line.starts_with("G91")) to_place = false;
    if (line.starts_with("G90")) to_place = true;
    if (line.starts_with("G28")) z_mm = 0;
    if (is_move(line)) {
      if (const auto z = word_of(all, at, 'Z')) {
        // Steps add up without the noise of their last digits.
        z_mm = to_place ? z->value : std::round((z_mm + z->value) * 1e6) / 1e6;
        moves_ = true;
        if (!layers_.empty()) {
          layers_.back().z_after_mm = z_mm;
          stops_mm.push_back(z_mm);
        }
      }
    }
    if (line.starts_with(dialect_.show)) {
      const std::size_t end = line_end(all, begin);
      const auto numbers =
          numbers_of(all, at + dialect_.show.size(),
                     std::min(end, std::max(all.find(';', at + 1), at + dialect_.show.size())));
      showing = !numbers.empty();
      if (!showing) continue;
      const auto number = static_cast<long>(std::min(numbers.front().value, 1e9));
      if (!layers_.empty() && layers_.back().number == number) continue;
      layers_.push_back({begin, number, 0, 0, 0, 0, 0, -1, 0, z_mm, z_mm});
      stops_before = stops_mm.size();
      stops_mm.clear();
      lit = done = switched = false;
      continue;
    }
    if (layers_.empty()) continue;
    Layer& layer = layers_.back();
    if (line.starts_with("M106")) {
      const auto power = word_of(all, at, 'S');
      lit = power && power->value > 0;
      if (lit && !switched) {
        // Waits before the image is shown are no exposure.
        layer.waits = 0;
        layer.wait_ms = layer.other_waits_ms = 0;
        layer.light = power->value;
        layer.z_mm = z_mm;
        switched = true;
      }
      if (!lit && switched) done = true;
    } else if (line.starts_with(dialect_.wait) && !done && (switched ? lit : showing)) {
      const auto wait = wait_of(at);
      if (!wait) continue;
      if (layer.waits++ == 0) {
        layer.z_mm = z_mm;
        layer.wait_begin = wait->begin;
        layer.wait_end = wait->end;
        layer.wait_ms = wait->ms;
      } else {
        layer.other_waits_ms += wait->ms;
      }
    } else if (line.starts_with(dialect_.wait) && dialect_.wait_word == 0) {
      const std::size_t from = all.find_first_not_of(" \t", at + dialect_.wait.size());
      const auto number = plain_number(all.substr(0, line_end(all, at)), from);
      if (number && number->value > 0) layer.dark_ms += number->value;
    }
  }
  end_last(stops_mm, stops_before);
}

/// After the last layer the platform goes away: that is no way of the layer.
void LayerGcode::end_last(const std::vector<double>& stops_mm, std::size_t stops_before) {
  if (layers_.size() < 2 || stops_mm.size() <= stops_before) return;
  layers_.back().z_after_mm = stops_before > 0 ? stops_mm[stops_before - 1] : layers_.back().z_mm;
}

void LayerGcode::fail(const std::string& message) const {
  throw InputError(file_, entry_, message);
}

/// Milliseconds of a line that waits; nothing when it says none.
std::optional<LayerGcode::Wait> LayerGcode::wait_of(std::size_t line) const {
  const std::string_view all = text_;
  std::size_t begin = line + dialect_.wait.size();
  // In one dialect lines that wait look like comments: they are read all the same.
  const std::size_t end = std::min(line_end(all, line), all.find(';', begin));
  const auto wrong = [&] {
    fail(shown_name(all.substr(line, line_end(all, line) - line)) + ": expected " +
         std::string(dialect_.wait) + (dialect_.wait_word ? " P" : " ") +
         "and milliseconds, as a plain number");
  };
  const auto skip_blanks = [&] {
    while (begin < end && kBlanks.find(all[begin]) != kBlanks.npos) ++begin;
  };
  skip_blanks();
  if (begin == end) return std::nullopt;
  if (dialect_.wait_word) {
    // With another word the line waits for seconds.
    if (all[begin] != dialect_.wait_word) wrong();
    ++begin;
    skip_blanks();
  }
  const auto number = plain_number(all.substr(0, end), begin);
  if (!number || number->value < 0) wrong();
  return Wait{number->begin, number->end, number->value};
}

bool LayerGcode::shows(int layers) const {
  if (layers_.size() < static_cast<std::size_t>(layers)) return false;
  long expected = dialect_.first;
  return std::all_of(layers_.begin(), layers_.end(),
                     [&](const Layer& l) { return l.number == expected++; });
}

std::vector<double> LayerGcode::exposures_s(int layers) const {
  if (!shows(layers)) return {};
  std::vector<double> times;
  for (int n = 0; n < layers; ++n) {
    const Layer& l = layers_[static_cast<std::size_t>(n)];
    if (l.waits == 0) return {};
    times.push_back(l.exposure_s());
  }
  return times;
}

std::vector<double> LayerGcode::light(int layers) const {
  if (!shows(layers)) return {};
  std::vector<double> light;
  bool said = false;
  for (int n = 0; n < layers; ++n) {
    const double power = layers_[static_cast<std::size_t>(n)].light;
    said = said || power >= 0;
    light.push_back(power >= 0 ? power : 255);
  }
  if (!said) light.clear();
  return light;
}

std::vector<double> LayerGcode::places_mm(int layers) const {
  if (!moves_ || !shows(layers)) return {};
  std::vector<double> places;
  const bool moves_after = layers_.front().z_mm == 0;
  for (int n = 0; n < layers; ++n) {
    const Layer& layer = layers_[static_cast<std::size_t>(n)];
    places.push_back(moves_after ? layer.z_after_mm : layer.z_mm);
  }
  return places;
}

bool LayerGcode::says(int layers,
                      const std::function<std::optional<double>(int layer)>& exposure_s) const {
  if (!shows(layers)) return false;
  for (int n = 0; n < layers; ++n) {
    const Layer& l = layers_[static_cast<std::size_t>(n)];
    const auto wanted_s = exposure_s(n);
    if (wanted_s && (l.waits == 0 || !is_same(*wanted_s, l.exposure_s()))) return false;
  }
  return true;
}

/// Replaces text [begin, end) in the copy of a layer.
struct LayerGcode::Edit {
  enum class Kind { count, height, exposure } kind = Kind::count;
  std::size_t begin = 0, end = 0;
  double value = 0;
  int decimals = 0;
};

std::string LayerGcode::exposure_text(const Layer& layer, double exposure_s) const {
  if (layer.waits == 0) {
    fail("has no exposure time of image " + std::to_string(layer.number) + " that could be set");
  }
  return number_text(std::max(0.0, std::round(exposure_s * 1000 - layer.other_waits_ms)));
}

/// Number of lines before the one that shows the image that belong to the layer: so many are alike
/// before the first and the second layer.
std::size_t LayerGcode::lead_lines() const {
  const std::string_view all = text_;
  std::size_t count = 0;
  if (layers_.size() < 2) {
    std::size_t at = layers_.front().shown;
    for (std::size_t lines = 1; at > 0 && lines < 20; ++lines) {
      at = line_before(all, at);
      if (!line_at(all, at).starts_with(';')) break;
      if (line_at(all, at).starts_with(";LAYER_START")) return lines;
    }
    return 0;
  }
  std::size_t a = layers_[0].shown, b = layers_[1].shown;
  while (a > 0 && count < 50) {
    a = line_before(all, a);
    b = line_before(all, b);
    if (b <= layers_[0].shown || !alike(line_at(all, a), line_at(all, b))) break;
    ++count;
  }
  return count;
}

LayerGcode::Block LayerGcode::last_block() const {
  const std::string_view all = text_;
  Block block;
  block.lead = lead_lines();
  block.begin = layers_.back().shown;
  for (std::size_t i = 0; i < block.lead; ++i) block.begin = line_before(all, block.begin);
  block.end = layers_.back().shown;
  if (layers_.size() < 2) {
    while (block.end < all.size() && !line_at(all, block.end).starts_with(";LAYER_END")) {
      block.end = next_line(all, block.end);
    }
    if (block.end < all.size()) block.end = next_line(all, block.end);
    while (block.end < all.size() && without_indent(line_at(all, block.end)).empty()) {
      block.end = next_line(all, block.end);
    }
    return block;
  }
  // As many lines as the layer before has, as far as they are alike.
  std::size_t until = layers_.back().shown;
  for (std::size_t i = 0; i < block.lead; ++i) until = line_before(all, until);
  for (std::size_t a = layers_[layers_.size() - 2].shown; a < until; a = next_line(all, a)) {
    if (block.end >= all.size() || !alike(line_at(all, a), line_at(all, block.end))) break;
    block.end = next_line(all, block.end);
  }
  return block;
}

std::vector<LayerGcode::Edit> LayerGcode::edits_of(const Block& block, double layer_mm) const {
  using Kind = Edit::Kind;
  const std::string_view all = text_;
  const Layer& layer = layers_.back();
  // The same lines of the layer before tell which numbers of comments count layers and heights.
  std::size_t before = layers_.size() < 2 ? all.npos : layers_[layers_.size() - 2].shown;
  for (std::size_t i = 0; before != all.npos && i < block.lead; ++i) {
    before = line_before(all, before);
  }
  std::vector<Edit> edits;
  for (std::size_t begin = block.begin; begin < block.end; begin = next_line(all, begin)) {
    const std::size_t end = line_end(all, begin);
    const std::string_view line = without_indent(line_at(all, begin));
    const auto at = static_cast<std::size_t>(line.data() - all.data());
    const auto add = [&](Kind kind, const Token& t) {
      edits.push_back({kind, t.begin, t.end, t.value, t.decimals});
    };
    if (line.starts_with(dialect_.show)) {
      const auto numbers = numbers_of(all, at + dialect_.show.size(), end);
      if (!numbers.empty() && static_cast<long>(numbers[0].value) == layer.number) {
        add(Kind::count, numbers.front());
      }
    } else if (layer.waits > 0 && layer.wait_begin >= begin && layer.wait_begin < end) {
      edits.push_back({Kind::exposure, layer.wait_begin, layer.wait_end, 0, 0});
    } else if (is_move(line)) {
      const auto z = absolute_ ? word_of(all, at, 'Z') : std::nullopt;
      if (z) add(Kind::height, *z);
    } else if (line.starts_with(';') && !line.starts_with(dialect_.wait) &&
               !line.starts_with(";<")) {
      const auto numbers = numbers_of(all, at, end);
      const auto earlier = before == all.npos ? std::vector<Token>{}
                                              : numbers_of(all, before, line_end(all, before));
      for (std::size_t i = 0; i < numbers.size(); ++i) {
        const double change = i < earlier.size() && earlier.size() == numbers.size()
                                  ? numbers[i].value - earlier[i].value
                                  : 0;
        const bool named_count = before == all.npos && line.starts_with(";LAYER_START");
        const bool named_height =
            before == all.npos && (line.starts_with(";currPos") || line.starts_with(";PositionZ"));
        if ((change == 1 && numbers[i].decimals == 0) || named_count) {
          add(Kind::count, numbers[i]);
        } else if (named_height || (layer_mm > 0 && std::abs(change - layer_mm) < 1e-4)) {
          add(Kind::height, numbers[i]);
        }
      }
    }
    if (before != all.npos) before = next_line(all, before);
  }
  return edits;
}

std::string LayerGcode::changed(
    int layers, double layer_mm,
    const std::function<std::optional<double>(int layer)>& exposure_s) const {
  const std::string_view all = text_;
  const auto count = static_cast<int>(layers_.size());
  std::string out;
  out.reserve(all.size());
  std::size_t at = 0;
  for (int n = 0; n < std::min(count, layers); ++n) {
    const Layer& layer = layers_[static_cast<std::size_t>(n)];
    const auto wanted_s = exposure_s(n);
    if (!wanted_s || (layer.waits > 0 && is_same(*wanted_s, layer.exposure_s()))) continue;
    const std::string text = exposure_text(layer, *wanted_s);
    out.append(all, at, layer.wait_begin - at).append(text);
    at = layer.wait_end;
  }
  if (layers > count) {
    if (count == 0) fail("shows no images whose G-code added layers could copy");
    const Block block = last_block();
    const Layer& last = layers_.back();
    if (block.end <= last.shown || (last.waits > 0 && last.wait_end > block.end)) {
      fail("does not tell where the G-code of its last layer ends, which added layers would copy");
    }
    const std::vector<Edit> edits = edits_of(block, layer_mm);
    out.append(all, at, block.end - at);
    at = block.end;
    if (!out.empty() && out.back() != '\n') out += '\n';
    for (int k = 1; k <= layers - count; ++k) {
      std::size_t from = block.begin;
      for (const Edit& e : edits) {
        out.append(all, from, e.begin - from);
        from = e.end;
        if (e.kind == Edit::Kind::exposure) {
          const auto wanted_s = exposure_s(count - 1 + k);
          out += wanted_s ? exposure_text(last, *wanted_s)
                          : std::string(all.substr(e.begin, e.end - e.begin));
        } else if (e.kind == Edit::Kind::count) {
          out += std::to_string(static_cast<long>(e.value) + k);
        } else {
          std::string z = number_text(std::round((e.value + k * layer_mm) * 1e6) / 1e6);
          const std::size_t point = z.find('.');
          const auto decimals =
              point == std::string::npos ? 0 : static_cast<int>(z.size() - point - 1);
          if (decimals == 0 && e.decimals > 0) z += '.';
          out += z + std::string(static_cast<std::size_t>(std::max(0, e.decimals - decimals)), '0');
        }
      }
      out.append(all, from, block.end - from);
      if (out.back() != '\n') out += '\n';
    }
  }
  out.append(all, at);
  return out;
}

}  // namespace slicecorr::detail
