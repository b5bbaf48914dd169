// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/bodies.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <limits>
#include <nlohmann/json.hpp>

#include "support/json/finite.hpp"

namespace slicecorr {

namespace {

/// What nothing is known of is NaN, and null in JSON.
double known(double value) { return value > 0 ? value : std::numeric_limits<double>::quiet_NaN(); }

const char* name_of(CupEnd end) {
  return end == CupEnd::closed ? "closed" : end == CupEnd::opened ? "opened" : "print_ends";
}

// Archives of others may know no scale: then slices, pixels and voxels are told.

std::string where(const Bodies& b, double column, double row) {
  if (!(b.grid.pixel_x_um > 0)) return fmt::format("at pixel {:.0f}, {:.0f}", column, row);
  const PlatePlace at = b.place(column, row);
  return fmt::format("at x {:.2f}, y {:.2f} mm", at.x_mm, at.y_mm);
}

std::string height(const Bodies& b, int slice) {
  return b.grid.layer_um > 0 ? fmt::format("{:.6g} um", b.slice_um(slice))
                             : fmt::format("slice {}", slice);
}

std::string volume(const Bodies& b, std::uint64_t voxels) {
  const double mm3 = b.voxels_mm3(voxels);
  return mm3 > 0 ? fmt::format("{:.4g} mm³", mm3) : fmt::format("{} voxels", voxels);
}

std::string plural(std::uint64_t count, const char* one, const char* many) {
  return count == 1 ? fmt::format("1 {}", one) : fmt::format("{} {}", count, many);
}

/// The largest of a list of many.
const char* largest(std::uint64_t count) { return count > 1 ? "the largest " : ""; }

}  // namespace

double Bodies::voxels_mm3(std::uint64_t voxels) const {
  if (!heights.alike()) return 0;
  return static_cast<double>(voxels) * known(grid.pixel_x_um) * known(grid.pixel_y_um) *
         known(grid.layer_um) * 1e-9;
}

double Bodies::pixels_mm2(std::uint64_t pixels) const {
  return static_cast<double>(pixels) * known(grid.pixel_x_um) * known(grid.pixel_y_um) * 1e-6;
}

PlatePlace Bodies::place(double column, double row) const {
  if (frame.orientation) return place_on_plate(grid, *frame.orientation, column, row);
  return {column * grid.pixel_x_um * 1e-3, row * grid.pixel_y_um * 1e-3};
}

std::string Bodies::to_json() const {
  using nlohmann::ordered_json;
  const auto number = [](double value) { return detail::finite_or_null(value); };
  const auto um = [&](int slice) {
    return grid.layer_um > 0 ? number(slice_um(slice)) : ordered_json();
  };
  const auto mm3 = [&](std::uint64_t voxels) {
    return heights.alike() ? number(voxels_mm3(voxels)) : ordered_json();
  };
  const bool pitch = grid.pixel_x_um > 0 && grid.pixel_y_um > 0;
  const auto put_place = [&](ordered_json& to, double column, double row) {
    const PlatePlace at = place(column, row);
    to["x_mm"] = pitch ? ordered_json(at.x_mm) : ordered_json();
    to["y_mm"] = pitch ? ordered_json(at.y_mm) : ordered_json();
  };
  ordered_json j;
  j["loose_bodies"] = loose_bodies;
  auto& list = j["islands"] = ordered_json::array();
  for (const Island& i : islands) {
    ordered_json one;
    one["first_um"] = um(i.first);
    one["until_um"] = i.until < 0 ? ordered_json() : ordered_json(um(i.until));
    one["begins_um"] = um(i.begins);
    one["volume_mm3"] = mm3(i.voxels);
    put_place(one, i.column, i.row);
    one["first_slice"] = i.first;
    one["pixel"] = {i.x, i.y};
    list.push_back(one);
  }
  j["islands_in_all"] = islands_in_all;
  auto& sealed = j["sealed_cavities"] = ordered_json::array();
  for (const SealedCavity& c : sealed_cavities) {
    ordered_json one;
    one["volume_mm3"] = mm3(c.voxels);
    one["first_um"] = um(c.first);
    one["last_um"] = um(c.past);
    put_place(one, c.column, c.row);
    sealed.push_back(one);
  }
  j["sealed_in_all"] = sealed_in_all;
  auto& open = j["cups"] = ordered_json::array();
  for (const Cup& c : cups) {
    ordered_json one;
    one["area_mm2"] = number(pixels_mm2(c.opening));
    one["closes_um"] = c.end == CupEnd::closed ? ordered_json(um(c.past)) : ordered_json();
    one["ends"] = name_of(c.end);
    one["first_um"] = um(c.first);
    one["until_um"] = um(c.past);
    put_place(one, c.column, c.row);
    open.push_back(one);
  }
  j["cups_in_all"] = cups_in_all;
  j["in_time"] = in_time;
  j["time_step_um"] = um(time_step);
  if (least_neck_mm2 > 0) {
    auto& thin = j["necks"] = ordered_json::array();
    for (const Neck& n : necks) {
      ordered_json one;
      one["area_mm2"] = number(pixels_mm2(n.voxels));
      one["at_um"] = um(n.slice);
      one["volume_mm3"] = mm3(n.borne);
      put_place(one, n.column, n.row);
      thin.push_back(one);
    }
    j["necks_in_all"] = necks_in_all;
    j["widest_mm2"] = number(pixels_mm2(widest));
  }
  return j.dump();
}

namespace {

void put_islands(const Bodies& b, std::vector<std::string>& words) {
  if (b.islands_in_all == 0) return;
  const Island& i = b.islands.front();
  const bool one = b.islands_in_all == 1;
  std::string text =
      fmt::format("{} on nothing when {}: {}from {} on {}, {}",
                  plural(b.islands_in_all, "body hangs", "bodies hang"),
                  one ? "it begins" : "they begin", largest(b.islands_in_all), height(b, i.first),
                  where(b, i.column, i.row), volume(b, i.voxels));
  // A front that is far from where a body gels leaves what joins it liquid for a while.
  if (i.begins > i.first) text += fmt::format(", gelled when {} is shown", height(b, i.begins));
  text += i.until < 0 ? std::string(", never joined to what hangs on the platform")
                      : ", until " + height(b, i.until);
  if (!one) {
    text += fmt::format("; {} to hang on the platform",
                        plural(b.loose_bodies, "body never comes", "bodies never come"));
  }
  words.push_back(text);
}

/// Islands of the design that light joins, of later slices, too.
void put_designed(const JudgedBodies& b, std::vector<std::string>& words) {
  if (b.designed.islands_in_all <= b.printed.islands_in_all) return;
  const std::size_t at = words.size();
  put_islands(b.designed, words);
  words[at] = fmt::format("by design, before light cures through to what is above: {}", words[at]);
}

void put_necks(const Bodies& b, std::vector<std::string>& words) {
  if (b.none_so_wide()) {
    words.push_back(fmt::format(
        "no body is as wide as the {:.4g} mm² by which each is to hang: the widest has {:.3g} mm² in a slice, so "
        "that none was judged by it",
        b.least_neck_mm2, b.pixels_mm2(b.widest)));
  }
  if (b.necks_in_all == 0) return;
  const Neck& n = b.necks.front();
  words.push_back(fmt::format("{} by less than {:.4g} mm²: {}{}, by {:.3g} mm² at {} {}",
                              plural(b.necks_in_all, "body hangs", "bodies hang"), b.least_neck_mm2,
                              largest(b.necks_in_all), volume(b, n.borne), b.pixels_mm2(n.voxels),
                              height(b, n.slice), where(b, n.column, n.row)));
}

void put_sealed(const Bodies& b, std::vector<std::string>& words) {
  if (b.sealed_in_all == 0) return;
  const SealedCavity& c = b.sealed_cavities.front();
  words.push_back(fmt::format(
      "{} resin that never drains, {}{}: {}from {} to {} {}",
      plural(b.sealed_in_all, "sealed cavity keeps", "sealed cavities keep"),
      volume(b, b.sealed_voxels), b.sealed_in_all == 1 ? "" : " in all", largest(b.sealed_in_all),
      height(b, c.first), height(b, c.past), where(b, c.column, c.row)));
}

void put_cups(const Bodies& b, std::vector<std::string>& words) {
  if (b.cups_in_all == 0) return;
  const Cup& c = b.cups.front();
  const double mm2 = b.pixels_mm2(c.opening);
  // Without a scale nobody knows how wide they are.
  if (!(mm2 >= kCupToldMm2)) return;
  const char* const until = c.end == CupEnd::closed   ? "until it closes at"
                            : c.end == CupEnd::opened ? "until it opens to the side at"
                                                      : "to the end of the print at";
  words.push_back(fmt::format("{} at the window: {}{:.4g} mm² wide, from {} {} {} {}",
                              plural(b.cups_in_all, "cup pulls", "cups pull"),
                              largest(b.cups_in_all), mm2, height(b, c.first), until,
                              height(b, c.past), where(b, c.column, c.row)));
}

void put_cut_loose(const JudgedBodies& b, std::vector<std::string>& words) {
  if (b.cut_loose() > 0) {
    words.push_back(
        fmt::format("{} loose that the design joins: {} loose in the print, {} in the design",
                    plural(b.cut_loose(), "body prints", "bodies print"), b.printed.loose_bodies,
                    b.designed.loose_bodies));
  }
  if (b.joined_in_part() > 0) {
    words.push_back(fmt::format(
        "{} loose that the design joins only by voxels that it covers in part, which do not all "
        "print",
        plural(b.joined_in_part(), "body prints", "bodies print")));
  }
}

}  // namespace

std::vector<std::string> bodies_in_words(const Bodies& b) {
  std::vector<std::string> words;
  put_islands(b, words);
  put_necks(b, words);
  put_sealed(b, words);
  put_cups(b, words);
  return words;
}

std::vector<std::string> bodies_in_words(const JudgedBodies& b) {
  std::vector<std::string> words = warnings_of(b);
  put_cups(b.printed, words);
  return words;
}

std::vector<std::string> warnings_of(const JudgedBodies& b) {
  std::vector<std::string> words;
  put_cut_loose(b, words);
  put_islands(b.printed, words);
  if (b.printed.islands_in_all > b.designed.islands_in_all) {
    words.push_back(fmt::format(
        "{} of them hang on what gels only by the light of later slices: the design holds them",
        b.printed.islands_in_all - b.designed.islands_in_all));
  }
  put_designed(b, words);
  put_necks(b.printed, words);
  put_sealed(b.printed, words);
  return words;
}

}  // namespace slicecorr
