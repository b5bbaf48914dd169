#include "stack/formats/archive_format.hpp"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <filesystem>

#include "slicecorr/error.hpp"
#include "slicecorr/units.hpp"
#include "stack/formats/known_foreign.hpp"
#include "stack/png/png.hpp"
#include "support/text/ascii.hpp"

namespace slicecorr::detail {
namespace {

bool is_digit(char c) { return c >= '0' && c <= '9'; }

std::string list_of_formats() {
  std::string list;
  for (const ArchiveFormat* f : all_archive_formats()) {
    list += (list.empty() ? "" : ", ") + std::string(f->name());
  }
  return list;
}

}  // namespace

const std::vector<const ArchiveFormat*>& all_archive_formats() {
  static const std::vector<const ArchiveFormat*> formats{
      &uvj_format(),   &sl1_format(),         &chitubox_zip_format(), &generic_zip_format(),
      &vdt_format(),   &rgb_nanodlp_format(), &nanodlp_format(),      &rgb_cws_format(),
      &cws_format(),   &ember_zip_format(),   &ember_tar_format(),    &vda_format(),
      &folder_format()};
  return formats;
}

const ArchiveFormat& recognise_format(const Container& archive) {
  for (const ArchiveFormat* f : all_archive_formats()) {
    if (f->container() == archive.kind() && f->recognises(archive)) return *f;
  }
  refuse_known_foreign(archive);
  throw InputError(archive.path(), "",
                   "is no slice archive of a known format; expected one of " + list_of_formats());
}

const ArchiveFormat& format_named(const std::string& name, const std::string& path,
                                  const std::string& like) {
  const auto& formats = all_archive_formats();
  if (!name.empty()) {
    for (const ArchiveFormat* f : formats) {
      if (f->name() == name) return *f;
    }
    throw InputError("format " + name + " is not known; expected one of " + list_of_formats());
  }
  // The longest ending counts: .rgb.cws is also .cws.
  const std::string file = lower_case(path_parts(path).file);
  std::size_t longest = 0;
  std::vector<const ArchiveFormat*> fitting;
  for (const ArchiveFormat* f : formats) {
    for (const std::string_view ending : f->endings()) {
      if (ending.size() < longest || file.size() <= ending.size() || !file.ends_with(ending)) {
        continue;
      }
      if (ending.size() > longest) fitting.clear();
      longest = ending.size();
      fitting.push_back(f);
    }
  }
  if (fitting.size() == 1) return *fitting.front();
  // Not every name without an ending: it may have been forgotten.
  std::error_code error;
  if (fitting.empty() && (path.ends_with('/') || std::filesystem::is_directory(path, error))) {
    return folder_format();
  }
  for (const ArchiveFormat* f : fitting) {
    if (f->name() == like) return *f;
  }
  if (!fitting.empty()) {
    std::string names;
    for (const ArchiveFormat* f : fitting) {
      names += (names.empty() ? "" : ", ") + std::string(f->name());
    }
    throw InputError(path, "",
                     "several formats end like this; expected one of them named: " + names);
  }
  std::vector<std::string_view> endings;
  for (const ArchiveFormat* f : formats) {
    for (const std::string_view e : f->endings()) {
      if (e != "/" && std::find(endings.begin(), endings.end(), e) == endings.end()) {
        endings.push_back(e);
      }
    }
  }
  std::string list;
  for (const std::string_view e : endings) list += std::string(e) + ", ";
  throw InputError(path, "",
                   "expected a name that ends in " + list + "or a folder, which ends in /");
}

std::vector<NumberedEntry> numbered_entries(const Container& archive, std::string_view prefix,
                                            std::string_view suffix) {
  std::vector<NumberedEntry> found;
  for (const Container::Entry& entry : archive.entries()) {
    std::string_view name = entry.name;
    if (!name.starts_with(prefix) || !name.ends_with(suffix) ||
        name.size() <= prefix.size() + suffix.size()) {
      continue;
    }
    name = name.substr(prefix.size(), name.size() - prefix.size() - suffix.size());
    // More digits than any number of layers has.
    if (name.size() > 9 || !std::all_of(name.begin(), name.end(), is_digit)) continue;
    long number = 0;
    std::from_chars(name.data(), name.data() + name.size(), number);
    found.push_back({number, &entry});
  }
  std::stable_sort(found.begin(), found.end(), [](const NumberedEntry& a, const NumberedEntry& b) {
    return a.number < b.number;
  });
  return found;
}

std::vector<std::string> complete_names(const Container& archive,
                                        const std::vector<NumberedEntry>& entries, long first,
                                        std::string_view what) {
  if (entries.empty()) {
    throw InputError(archive.path(), "", "has no layer images, expected " + std::string(what));
  }
  std::vector<std::string> names;
  names.reserve(entries.size());
  for (const NumberedEntry& e : entries) {
    const long expected = first + static_cast<long>(names.size());
    if (e.number != expected) {
      throw InputError(archive.path(), shown_name(e.entry->name),
                       e.number < expected
                           ? "has the number of another image"
                           : "follows a gap: image " + std::to_string(expected) + " is missing");
    }
    names.push_back(e.entry->name);
  }
  return names;
}

ImageSize image_size(const Container& archive, const std::string& name) {
  const Container::Entry* const entry = archive.find(name);
  if (entry == nullptr) throw InputError(archive.path(), name, "is missing");
  std::vector<std::uint8_t> png;
  archive.read(*entry, std::uint64_t{1} << 32, png);
  const PngHeader header = read_png_header(png, {archive.path(), name});
  if (header.width > 3 * 65536 || header.height > 65536) {
    throw InputError(archive.path(), shown_name(name),
                     "is " + std::to_string(header.width) + " x " + std::to_string(header.height) +
                         " pixels, expected at most 65536 x 65536");
  }
  return {static_cast<int>(header.width), static_cast<int>(header.height), header.channels()};
}

std::optional<LeadingNumber> leading_number(std::string_view text) {
  LeadingNumber number;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), number.value);
  if (error != std::errc() || !std::isfinite(number.value)) return std::nullopt;
  number.length = static_cast<std::size_t>(end - text.data());
  const std::string_view rest = text.substr(number.length);
  // A unit, as far as the next blank or bracket; none begins with the letters of exponents and
  // other bases.
  const std::string_view unit = rest.substr(0, rest.find_first_of(" \t\r\n);"));
  constexpr std::string_view begins_no_unit = "eExXpP", other_than_units = "0123456789_.,'+-";
  if (!unit.empty() && begins_no_unit.find(unit.front()) != unit.npos && unit != "px" &&
      !unit.starts_with("px/")) {
    return std::nullopt;
  }
  if (unit.find_first_of(other_than_units) != unit.npos) return std::nullopt;
  // Thousands that are set apart by blanks.
  const std::size_t next = rest.find_first_not_of(" \t", unit.size());
  if (unit.empty() && next != rest.npos && is_digit(rest[next])) return std::nullopt;
  return number;
}

KeyValueText::KeyValueText(std::string text, char separator, std::string file, std::string entry,
                           std::string prefix)
    : text_(std::move(text)),
      file_(std::move(file)),
      entry_(std::move(entry)),
      prefix_(std::move(prefix)),
      separator_(separator) {}

std::optional<KeyValueText::TextRange> KeyValueText::place(std::string_view key) const {
  const std::string_view all = text_;
  for (std::size_t start = 0; start < all.size();) {
    const std::size_t end = std::min(all.find('\n', start), all.size());
    std::string_view line = all.substr(start, end - start);
    std::string_view rest = trimmed(line);
    if (rest.starts_with(prefix_)) {
      rest.remove_prefix(prefix_.size());
      const std::size_t at = rest.find(separator_);
      if (at != rest.npos && trimmed(rest.substr(0, at)) == key) {
        const std::string_view value = trimmed(rest.substr(at + 1));
        const std::size_t begin = value.empty()
                                      ? static_cast<std::size_t>(rest.data() + at + 1 - all.data())
                                      : static_cast<std::size_t>(value.data() - all.data());
        return TextRange{begin, begin + value.size()};
      }
    }
    start = end + 1;
  }
  return std::nullopt;
}

std::optional<std::string> KeyValueText::find(std::string_view key) const {
  const auto at = place(key);
  if (!at) return std::nullopt;
  return text_.substr(at->begin, at->end - at->begin);
}

std::optional<double> KeyValueText::number(std::string_view key, double least, double most) const {
  const auto value = find(key);
  if (!value) return std::nullopt;
  double number = NAN;
  const auto [end, error] = std::from_chars(value->data(), value->data() + value->size(), number);
  if (error != std::errc() || end != value->data() + value->size() ||
      !(number >= least && number <= most)) {
    throw InputError(file_, entry_,
                     std::string(key) + " is " + shown_name(*value) + ", expected a number from " +
                         number_text(least) + " to " + number_text(most));
  }
  return number;
}

double KeyValueText::need_number(std::string_view key, double least, double most) const {
  const auto value = number(key, least, most);
  if (!value) throw InputError(file_, entry_, std::string(key) + " is missing");
  return *value;
}

void KeyValueText::set(std::string_view key, const std::string& value) {
  if (const auto at = place(key)) {
    text_.replace(at->begin, at->end - at->begin, value);
    return;
  }
  if (!text_.empty() && text_.back() != '\n') text_ += '\n';
  text_ += prefix_ + std::string(key);
  text_ += separator_ == '=' ? " = " : std::string(1, separator_);
  text_ += value + "\n";
}

std::string number_text(double value) {
  char text[40];
  const auto [end, error] = std::to_chars(text, text + sizeof text, value);
  (void)error;  // there is room for every number
  // Some readers take no exponent.
  std::string shortest(text, end);
  if (shortest.find('e') == std::string::npos) return shortest;
  const auto [fixed_end, fixed_error] =
      std::to_chars(text, text + sizeof text, value, std::chars_format::fixed);
  return fixed_error == std::errc() ? std::string(text, fixed_end) : shortest;
}

SliceLight light_of_layer(const StackInfo& info, int layer) {
  const double m = info.resin ? info.resin->m : 1.0;
  if (info.kind == StackKind::recorded && info.process) {
    // An image is no slice: what the plan gives one.
    return {planned_light_s(*info.process, info.grid.layer_um, layer), 1};
  }
  if (info.kind == StackKind::corrected && info.process) {
    return slice_light(*info.process, m, info.grid.layer_um, layer, info.grid.layers);
  }
  // Without a copy of the whole list for each of its layers.
  if (const auto& times_s = info.layer_exposure_s; !times_s.empty()) {
    return {times_s[std::min(static_cast<std::size_t>(layer), times_s.size() - 1)], 1};
  }
  return slice_light(process_of_times(info), m, info.grid.layer_um, layer, info.grid.layers);
}

bool same_time(double a_s, double b_s) {
  return std::abs(a_s - b_s) <= std::min(0.0051, 0.01 * std::abs(b_s));
}

namespace {

/// The same time for the first layers, equal steps to the normal one, and that for all others:
/// whether times of single layers are no more than this.
bool follows_pattern(const std::vector<double>& times_s, ExposureSummary& s) {
  Process p;
  p.mode = ExposureMode::layerwise;
  p.exposure_s = times_s.back();
  p.bottom_exposure_s = times_s.front();
  std::size_t n = 0;
  while (n < times_s.size() && times_s[n] == times_s.front()) ++n;
  p.bottom_layers = static_cast<int>(n);
  while (n < times_s.size() && times_s[n] != times_s.back()) ++n;
  p.fade_layers = static_cast<int>(n) - p.bottom_layers;
  for (std::size_t k = 0; k < times_s.size(); ++k) {
    if (!same_time(times_s[k], layer_exposure_s(p, static_cast<int>(k)))) return false;
  }
  s.normal_s = p.exposure_s;
  s.bottom_s = p.bottom_exposure_s;
  const bool alike = p.bottom_exposure_s == p.exposure_s;
  s.bottom_layers = alike ? 0 : p.bottom_layers;
  s.fade_layers = alike ? 0 : p.fade_layers;
  return true;
}

}  // namespace

ExposureSummary exposure_summary(const StackInfo& info) {
  const Process p = process_of_times(info);
  ExposureSummary s;
  if (p.mode == ExposureMode::continuous) {
    s.normal_s = s.bottom_s = units::slice_time_s(info.grid.layer_um, p.speed_mm_h);
    s.uneven = p.ramp == Ramp::lamp_follows;
    if (s.uneven) s.bottom_s = light_of_layer(info, 0).time_s;
    return s;
  }
  s.normal_s = s.bottom_s = p.exposure_s;
  if (!p.layer_exposure_s.empty()) {
    s.uneven = !follows_pattern(p.layer_exposure_s, s);
    if (s.uneven) s.bottom_s = p.layer_exposure_s.front();
  } else if (p.bottom_exposure_s > 0 && p.bottom_layers + p.fade_layers > 0) {
    s.bottom_s = p.bottom_exposure_s;
    s.bottom_layers = p.bottom_layers;
    s.fade_layers = p.fade_layers;
  }
  return s;
}

}  // namespace slicecorr::detail

namespace slicecorr {

std::vector<FormatInfo> archive_formats() {
  std::vector<FormatInfo> list;
  for (const detail::ArchiveFormat* f : detail::all_archive_formats()) {
    const auto endings = f->endings();
    list.push_back(
        {std::string(f->name()), std::string(f->what()), {endings.begin(), endings.end()}});
  }
  return list;
}

Process process_of_times(const StackInfo& info) {
  const bool ours = info.kind == StackKind::corrected || info.kind == StackKind::recorded;
  if (ours && info.process) return *info.process;
  Process p;
  p.mode = ExposureMode::layerwise;
  p.exposure_s = info.exposure_s;
  p.bottom_exposure_s = info.bottom_exposure_s;
  p.bottom_layers = info.bottom_layers;
  p.fade_layers = info.fade_layers;
  p.layer_exposure_s = info.layer_exposure_s;
  return p;
}

double light_on_s(const StackInfo& info) {
  if (info.recording && info.process) {
    double sum = 0;
    for (int n = 0; n < info.recording->slices(); ++n) {
      const double planned = planned_light_s(*info.process, info.grid.layer_um, n);
      for (const Recording::Showing& p : info.recording->of(n)) sum += p.light * planned;
    }
    return sum;
  }
  return light_on_s(process_of_times(info), info.resin ? info.resin->m : 1.0, info.grid.layer_um,
                    info.grid.layers);
}

std::string format_of(const StackFile& file, const std::string& like) {
  return std::string(detail::format_named(file.format, file.path, like).name());
}

}  // namespace slicecorr
