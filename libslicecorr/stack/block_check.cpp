// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "stack/block_check.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "slicecorr/error.hpp"
#include "stack/isa_l.hpp"

namespace slicecorr::detail {
namespace {

using Json = nlohmann::json;

/// Our block has four levels; JSON that is deeper than this is not ours.
constexpr int kDeepest = 16;

std::string text_of(const Json& text) {
  return text.dump(-1, ' ', false, Json::error_handler_t::replace);
}

void append(const Json& value, int depth, std::string& out) {
  if (depth > kDeepest) {
    out += '?';
  } else if (value.is_number()) {
    const double number = value.get<double>();
    out += number_text(number == 0 ? 0 : number);
  } else if (value.is_object()) {
    out += '{';
    for (const auto& [key, member] : value.items()) {
      if (depth == 0 && key == kBlockCrc32Key) continue;
      out += text_of(key) + ':';
      append(member, depth + 1, out);
      out += ',';
    }
    out += '}';
  } else if (value.is_array()) {
    out += '[';
    for (const Json& item : value) {
      append(item, depth + 1, out);
      out += ',';
    }
    out += ']';
  } else {
    out += text_of(value);
  }
}

[[noreturn]] void contradicts(const std::string& file, const std::string& what) {
  throw InputError(file, "",
                   "contradicts itself: " + what +
                       "; expected the stack as `slicecorr` wrote it. For another process correct "
                       "the part again");
}

/// Whether two times differ by more than archives round: some to hundredths of seconds, some to
/// milliseconds.
bool differ(double archive_s, double planned_s, double rounding) {
  return std::abs(archive_s - planned_s) > (0.01 + rounding) * planned_s + 0.00051;
}

std::string plan_in_words(const Process& p, double planned_s) {
  if (p.mode == ExposureMode::layerwise) return fmt::format("{:.5g} s", planned_s);
  return fmt::format("{:.5g} s at {:g} mm/h", planned_s, p.speed_mm_h);
}

/// What the archive says of light must be what the process asks for: within a step of 1/255.
void check_light(const StackInfo& info, const std::string& file) {
  // Only of some formats it is sure that none said is full.
  const bool said = !info.light_share.empty() || info.format == "uvj";
  if (!said || info.kind == StackKind::recorded) return;
  for (int n = 0; n < info.grid.layers; ++n) {
    const double planned = light_of_layer(info, n).share;
    const std::vector<double>& shares = info.light_share;
    const double says =
        shares.empty() ? 1.0 : shares[std::min(static_cast<std::size_t>(n), shares.size() - 1)];
    if (std::abs(says - planned) <= 0.6 / 255) continue;
    contradicts(file,
                fmt::format("its process plans {:.4g} % of full light for slice {}, the archive "
                            "says {:.4g} %",
                            100 * planned, n, 100 * says));
  }
}

void check_images(const StackInfo& info, const std::string& file) {
  const Printer& p = *info.printer;
  const Grid is = info.grid, shown = images_of(p, image_frame(info));
  const auto differ = [](double a, double b) { return a > 0 && std::abs(a - b) > 0.01 * b; };
  if (is.width_px == shown.width_px && is.height_px == shown.height_px &&
      !differ(is.pixel_x_um, shown.pixel_x_um) && !differ(is.pixel_y_um, shown.pixel_y_um)) {
    return;
  }
  const auto words = [](const Grid& g) {
    return fmt::format("{} x {} pixels of {:g} x {:g} um", g.width_px, g.height_px, g.pixel_x_um,
                       g.pixel_y_um);
  };
  contradicts(file, fmt::format("its images are {}, those of its printer '{}' {}", words(is),
                                p.name, words(shown)));
}

}  // namespace

void check_times(const StackInfo& plan, const StackInfo& says, const std::string& file,
                 double rounding) {
  const auto check = [&](double archive_s, double planned_s, const std::string& of) {
    if (!differ(archive_s, planned_s, rounding)) return;
    contradicts(file, fmt::format("its process plans {} for {}, the archive says {:.5g} s",
                                  plan_in_words(process_of_times(plan), planned_s), of, archive_s));
  };
  if (!says.layer_exposure_s.empty()) {
    const auto count = std::min(says.layer_exposure_s.size(),
                                static_cast<std::size_t>(std::max(0, says.grid.layers)));
    for (std::size_t n = 0; n < count; ++n) {
      const double planned_s = light_on_of_layer(plan, static_cast<int>(n));
      if (differ(says.layer_exposure_s[n], planned_s, rounding)) {
        check(says.layer_exposure_s[n], planned_s, fmt::format("slice {}", n));
      }
    }
    return;
  }
  if (!(says.exposure_s > 0)) return;
  const ExposureSummary s = exposure_summary(plan);
  check(says.exposure_s, s.normal_s, "a slice");
  // Formats without times of single layers can't express every schedule.
  if (says.bottom_layers > 0 && says.bottom_exposure_s > 0 && !s.uneven) {
    check(says.bottom_exposure_s, s.bottom_s, "the first slice");
  }
}

std::uint32_t block_crc32(const nlohmann::json& block) {
  std::string text;
  append(block, 0, text);
  return isal::crc32(0, reinterpret_cast<const unsigned char*>(text.data()), text.size());
}

void check_block(const ArchiveContents& contents, const std::string& file) {
  const StackInfo& info = contents.info;
  const int layers = info.grid.layers;
  const bool added = info.kind == StackKind::corrected;
  const bool ours = info.kind == StackKind::target || added;
  if (ours && info.target_layers > 0 &&
      (added ? info.target_layers > layers : info.target_layers != layers)) {
    contradicts(file,
                fmt::format("its part has {} layers, the archive {}", info.target_layers, layers));
  }
  const bool lit = added || info.kind == StackKind::recorded;
  if (info.printer) check_images(info, file);
  if (info.process && lit) {
    check_times(info, info, file, 0.5 * contents.layer_step_um / info.grid.layer_um);
    check_light(info, file);
  }
  if (contents.block_changed) {
    throw InputError(file, "",
                     "its parameters were changed after the stack was made (checksum): its images "
                     "were computed for another printer, resin, process or size; expected the "
                     "stack as `slicecorr` wrote it. For other parameters correct the part again");
  }
}

}  // namespace slicecorr::detail
