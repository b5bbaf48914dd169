#include "database/schema.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>

#include "slicecorr/error.hpp"

namespace slicecorr::resins {

namespace {

using enum KeyType;

constexpr std::array resin_rules = std::to_array<KeyRule>({
    {.key = "name", .what = "stable name, that of the file"},
    {.key = "version",
     .type = whole,
     .low = 1,
     .high = 1e9,
     .what = "rises with every change that is saved"},
    {.key = "maker", .what = "who makes it"},
    {.key = "product", .what = "the maker's name for it"},
    {.key = "chemistry", .what = "such as acrylate, methacrylate, epoxy"},
    {.key = "colour", .what = "a word, or #RRGGBB"},
    {.key = "notes", .what = "anything else"},
    {.table = "cure",
     .key = "model",
     .type = choice,
     .choices = "jacobs|kinetic",
     .what = "working curve; jacobs without it"},
    {.table = "cure",
     .key = "m",
     .type = number,
     .high = 2,
     .what = "exponent of intensity; 1 without it, and for jacobs"},
    {.table = "cure",
     .key = "wavelength_nm",
     .type = number,
     .low = 100,
     .high = 2000,
     .what = "of the curing light"},
    {.table = "cure",
     .key = "absorbance_height_um",
     .type = number,
     .high = 1e7,
     .required = true,
     .what = "over which the curing light falls to 1/e or 1/10"},
    {.table = "cure",
     .key = "absorbance_base",
     .type = base,
     .required = true,
     .what = "which of the two"},
    {.table = "cure",
     .key = "gel_dose_mj_cm3",
     .type = number,
     .high = 1e9,
     .what = "measured gel dose, volumetric"},
    {.table = "cure",
     .key = "gel_dose_mj_cm2",
     .type = number,
     .high = 1e9,
     .what = "... or areal"},
    {.table = "cure",
     .key = "dose_factor",
     .type = number,
     .high = 1e3,
     .what = "dose aimed at over gel dose; 5 without it (1 for critical_dose_prime)"},
    {.table = "cure",
     .key = "critical_dose_mj_cm3",
     .type = number,
     .high = 1e9,
     .what = "dose aimed at in place of gel dose times factor, volumetric"},
    {.table = "cure",
     .key = "critical_dose_mj_cm2",
     .type = number,
     .high = 1e9,
     .what = "... or areal"},
    {.table = "cure",
     .key = "critical_dose_prime",
     .type = number,
     .high = 1e9,
     .what = "D'c of a kinetic fit, (mW/cm²)^m·s; the gel dose when dose_factor stands beside it"},
    {.table = "inhibition",
     .key = "beta",
     .type = number,
     .high = 1e6,
     .required = true,
     .what = "UV counts so many times against blue, areal"},
    {.table = "inhibition",
     .key = "absorbance_height_um",
     .type = number,
     .high = 1e7,
     .required = true,
     .what = "of the UV light; less than that of the curing light"},
    {.table = "inhibition",
     .key = "absorbance_base",
     .type = base,
     .required = true,
     .what = "1/e or 1/10"},
    {.table = "inhibition",
     .key = "wavelength_nm",
     .type = number,
     .low = 100,
     .high = 2000,
     .what = "of the UV light"},
    {.table = "inhibition",
     .key = "m",
     .type = number,
     .high = 2,
     .what = "exponent under UV; that of [cure] without it"},
    {.table = "inhibition",
     .key = "critical_dose_prime",
     .type = number,
     .high = 1e9,
     .what = "gel dose D'c that belongs to this m; that of [cure] without it"},
    {.table = "provenance",
     .key = "*",
     .type = notes,
     .what = "where the figures come from; `measurements` lists CSV files beside the resin file"},
    {.table = "composition",
     .key = "*",
     .type = parts,
     .high = 100,
     .low_counts = true,
     .what = "component and its share, wt%"},
});

constexpr std::array printer_rules = std::to_array<KeyRule>({
    {.key = "name", .what = "stable name, that of the file"},
    {.key = "version",
     .type = whole,
     .low = 1,
     .high = 1e9,
     .what = "rises with every change that is saved"},
    {.key = "maker", .what = "who makes it"},
    {.key = "product", .what = "the maker's name for it"},
    {.key = "notes", .what = "anything else"},
    {.table = "display",
     .key = "width_px",
     .type = whole,
     .low = 1,
     .high = 65536,
     .required = true,
     .what = "pixels along x"},
    {.table = "display",
     .key = "height_px",
     .type = whole,
     .low = 1,
     .high = 65536,
     .required = true,
     .what = "pixels along y"},
    {.table = "display",
     .key = "pixel_um",
     .type = pixel,
     .high = 1e4,
     .required = true,
     .what = "side of a pixel at the window, or [x, y]"},
    {.table = "display",
     .key = "bit_depth",
     .type = whole,
     .low = 1,
     .high = 8,
     .what = "all 2^bit_depth levels exist; 8 without it"},
    {.table = "display",
     .key = "mirror",
     .type = mirror,
     .choices = "none|x|y|xy",
     .what = "how the plate is mirrored in the images that the display shows; true is x"},
    {.table = "display",
     .key = "orientation",
     .type = choice,
     .choices = "landscape|portrait",
     .what = "how the plate lies in them; width and height above are those of these images"},
    {.table = "display",
     .key = "flat_field",
     .type = file,
     .what = "PNG of relative intensity over the display, white the brightest"},
    {.table = "display",
     .key = "flat_field_frame",
     .type = choice,
     .choices = "image|plate",
     .what = "whether that picture lies like the display's images or like the plate; image without "
             "it"},
    {.table = "display",
     .key = "flat_field_reference",
     .type = whole,
     .low = 1,
     .high = 255,
     .what = "value of that picture where the calibration holds; its greatest without it"},
    {.table = "display",
     .key = "flat_field_least",
     .type = number,
     .high = 1,
     .low_counts = true,
     .what = "least value of that image, 1 the greatest"},
    {.table = "display",
     .key = "flat_field_mean",
     .type = number,
     .high = 1,
     .low_counts = true,
     .what = "mean of that image, 1 the greatest"},
    {.table = "blue",
     .key = "wavelength_nm",
     .type = number,
     .low = 100,
     .high = 2000,
     .what = "of the curing light"},
    {.table = "blue",
     .key = "calibration",
     .type = calibration,
     .required = true,
     .what = "grey level and mW/cm² at the window, all levels, never falling"},
    {.table = "uv",
     .key = "wavelength_nm",
     .type = number,
     .low = 100,
     .high = 2000,
     .what = "of the inhibiting light"},
    {.table = "uv",
     .key = "kind",
     .type = choice,
     .choices = "flood|patterned",
     .what = "one lamp over the window, or an image per slice; flood without it"},
    {.table = "uv",
     .key = "calibration",
     .type = calibration,
     .required = true,
     .what = "control value (or grey level) and mW/cm²"},
    {.table = "stage",
     .key = "max_speed_mm_h",
     .type = number,
     .high = 1e9,
     .what = "fastest print speed"},
    {.table = "stage", .key = "travel_mm", .type = number, .high = 1e6, .what = "greatest height"},
    {.table = "modbus", .key = "*", .type = anything, .what = "register map; its reader checks it"},
    {.table = "provenance", .key = "*", .type = notes, .what = "where the figures come from"},
});

std::string expected_of(const KeyRule& r) {
  const auto range = [&] {
    return fmt::format("{} {:g}, at most {:g}", r.low_counts ? "from" : "above", r.low, r.high);
  };
  const auto listed = [&] {
    std::string list(r.choices);
    for (std::size_t at = 0; (at = list.find('|', at)) != std::string::npos;) {
      list.replace(at, 1, ", ");
    }
    return list;
  };
  switch (r.type) {
    case text:
      return "text";
    case number:
      return "number " + range();
    case whole:
      return fmt::format("whole number, {:g} to {:g}", r.low, r.high);
    case choice:
      return "one of " + listed();
    case base:
      return "10 or \"e\"";
    case pixel:
      return "number or [x, y], " + range();
    case calibration:
      return "[[level, mW/cm²], ...] or a .csv";
    case mirror:
      return "true, false or one of " + listed();
    case file:
      return "file name";
    case notes:
      return "texts, numbers, dates, lists of texts";
    case parts:
      return "numbers " + range();
    case anything:
      return "anything";
  }
  return "";
}

}  // namespace

std::span<const KeyRule> schema(std::string_view kind) {
  if (kind == "printer") return printer_rules;
  return resin_rules;
}

std::string schema_table(std::string_view kind) {
  std::string out = "| table | key | value | what |\n|---|---|---|---|\n";
  for (const KeyRule& r : schema(kind)) {
    out += fmt::format("| {} | {} | {}{} | {} |\n",
                       r.table.empty() ? "" : fmt::format("`[{}]`", r.table),
                       r.key == "*" ? "any" : fmt::format("`{}`", r.key), expected_of(r),
                       r.required ? "; required" : "", r.what);
  }
  return out;
}

bool is_stable_name(std::string_view name) {
  const auto good = [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') || c == '-' || c == '.' || c == '_';
  };
  return !name.empty() && name.size() <= 100 && std::all_of(name.begin(), name.end(), good) &&
         name[0] != '-' && name[0] != '.' && name[0] != '_' && !name.ends_with(".toml");
}

}  // namespace slicecorr::resins
