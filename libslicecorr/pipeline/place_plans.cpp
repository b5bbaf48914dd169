#include "pipeline/place_plans.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "pipeline/bands.hpp"
#include "slicecorr/error.hpp"

namespace slicecorr::detail {

namespace {

/// The printer, if the target's images are of its size.
const Printer& fitting(const Printer& printer, const SliceSource& target) {
  const Grid& grid = target.grid();
  // Archives made for a printer have the images of its display, ours those of its plate.
  const Grid wanted = images_of(printer, target.frame());
  if (grid.width_px != wanted.width_px || grid.height_px != wanted.height_px) {
    throw InputError(fmt::format("the slices are {} x {} pixels; printer '{}' has {} x {}",
                                 grid.width_px, grid.height_px, printer.name, wanted.width_px,
                                 wanted.height_px));
  }
  const auto differ = [](double a, double b) { return std::abs(a - b) > 0.01 * b; };
  if (differ(grid.pixel_x_um, wanted.pixel_x_um) || differ(grid.pixel_y_um, wanted.pixel_y_um)) {
    throw InputError(fmt::format(
        "the slices were made for pixels of {:g} x {:g} um; those of printer '{}' are {:g} x {:g} "
        "um",
        grid.pixel_x_um, grid.pixel_y_um, printer.name, wanted.pixel_x_um, wanted.pixel_y_um));
  }
  return printer;
}

void check_travel(int slices, int layers, double layer_um, const Printer& printer) {
  const double travel_mm = slices * layer_um * 1e-3;
  if (printer.travel_mm <= 0 || travel_mm <= printer.travel_mm * (1 + 1e-9)) return;
  if (slices == layers) {
    throw InfeasibleError(
        fmt::format("the part is {:.3f} mm high; the stage of '{}' travels {:g} mm", travel_mm,
                    printer.name, printer.travel_mm));
  }
  throw InfeasibleError(fmt::format(
      "curing the part's end takes {} slices after it, {:.3f} mm in all; the stage "
      "of '{}' travels "
      "{:g} mm. Print slower, with more light, or a part at least {:.3f} mm lower",
      slices - layers, travel_mm, printer.name, printer.travel_mm, travel_mm - printer.travel_mm));
}

/// What of each value is lit, and up to which layer.
struct LitPlaces {
  LightCounts columns{};
  std::array<std::int32_t, 256> end;  ///< 1 more than the last lit layer
  std::array<Pixel, 256> first;       ///< in reading order

  LitPlaces() { end.fill(0); }
  void add(std::uint8_t value, Pixel pixel, std::int32_t lit_end) {
    const Pixel& f = first[value];
    const bool earlier = pixel.y < f.y || (pixel.y == f.y && pixel.x < f.x);
    if (columns[value] == 0 || earlier) first[value] = pixel;
    ++columns[value];
    end[value] = std::max(end[value], lit_end);
  }
  void merge(const LitPlaces& o) {
    for (std::size_t v = 0; v < 256; ++v) {
      if (o.columns[v] == 0) continue;
      const std::uint64_t sum = columns[v] + o.columns[v];
      add(static_cast<std::uint8_t>(v), o.first[v], o.end[v]);
      columns[v] = sum;
    }
  }
};

LitPlaces lit_places(const SliceSource& target, const LightMap& map, const Job& job) {
  const auto bands = bands_of(target.grid(), target.bounds());
  LitPlaces all;
  std::mutex merging;
  parallel_for(job, "find lit places", bands.size(), [&](std::size_t i) {
    const PixelBox& band = bands[i];
    const std::size_t columns = columns_of(band);
    std::vector<std::int32_t> end(columns, 0);
    target.read_band(band, [&](int n, const std::uint8_t* rows) {
      if ((n & 63) == 0) job.check_cancelled();
      if (!rows) return;
      for (std::size_t k = 0; k < columns; ++k) end[k] = rows[k] ? n + 1 : end[k];
    });
    LitPlaces found;
    std::size_t k = 0;
    for (int y = band.y0; y < band.y1; ++y) {
      for (int x = band.x0; x < band.x1; ++x, ++k) {
        if (end[k] > 0) found.add(map.value(x, y), {x, y}, end[k]);
      }
    }
    const std::lock_guard lock(merging);
    all.merge(found);
  });
  return all;
}

/// The first pixel of a value in reading order.
Pixel first_of(const LightMap& map, const Grid& grid, std::uint8_t value) {
  for (int y = 0; y < grid.height_px; ++y) {
    for (int x = 0; x < grid.width_px; ++x) {
      if (map.value(x, y) == value) return {x, y};
    }
  }
  return {};
}

std::string share_in_words(const LightMap& map, std::uint8_t value) {
  return fmt::format("{:.4g} of the light of the calibration", map.factor(value));
}

}  // namespace

PlacePlans::PlacePlans(const SliceSource& target, const Setup& setup, const Job& job)
    : process_(setup.process),
      models_(fitting(setup.printer, target), setup.resin, setup.process, target.grid(),
              target.frame()),
      layers_(target.grid().layers),
      levels_(setup.printer.levels()) {
  refuse_recording(target);
  if (even()) {
    const CureModel& model = models_.brightest();
    check_feasible(model, setup.printer, setup.process);
    all_layers_ = slices_with_burst(model, layers_, layers_ - 1);
  } else {
    check_uneven(target, setup, job);
  }
  check_travel(all_layers_, layers_, target.grid().layer_um, setup.printer);
}

void PlacePlans::check_uneven(const SliceSource& target, const Setup& setup, const Job& job) {
  const Grid& grid = target.grid();
  const LightMap& map = models_.map();
  const auto refusal = [&](std::uint8_t value) -> std::string {
    if (value == 0) return "no light";
    try {
      check_feasible(models_.model(value), models_.printer_at(value), setup.process);
    } catch (const InfeasibleError& e) {
      return e.what();
    }
    return {};
  };
  // Everywhere, lit or not, black must leave the resin liquid; where it does not is brightest.
  const LightCounts display = map.counts({0, 0, grid.width_px, grid.height_px});
  std::uint8_t brightest = 255;
  while (display[brightest] == 0) --brightest;
  if (const std::string text = refusal(brightest); !text.empty()) {
    const Pixel p = first_of(map, grid, brightest);
    throw InfeasibleError(
        fmt::format("at the brightest place of the display, pixel {}, {}, which "
                    "gets {}: {}",
                    p.x, p.y, share_in_words(map, brightest), text));
  }
  const int burst = slices_with_burst(models_.model(brightest), layers_, layers_ - 1);
  const LightCounts part = map.counts(target.bounds());
  bool alike = true;
  for (std::size_t v = 0; v < 256 && alike; ++v) {
    const auto value = static_cast<std::uint8_t>(v);
    alike =
        part[v] == 0 || (refusal(value).empty() &&
                         slices_with_burst(models_.model(value), layers_, layers_ - 1) == burst);
  }
  all_layers_ = burst;
  if (alike) return;
  // A dim place counts only where the part is lit.
  const LitPlaces lit = lit_places(target, map, job);
  all_layers_ = layers_;
  for (std::size_t v = 0; v < 256; ++v) {
    if (lit.columns[v] == 0) continue;
    const auto value = static_cast<std::uint8_t>(v);
    if (const std::string text = refusal(value); !text.empty()) {
      std::uint64_t pixels = 0;
      for (std::size_t w = v; w < 256; ++w) {
        if (lit.columns[w] && !refusal(static_cast<std::uint8_t>(w)).empty())
          pixels += lit.columns[w];
      }
      const Pixel p = lit.first[v];
      if (value == 0) {
        throw InfeasibleError(fmt::format(
            "the part lies where the flat-field of printer '{}' says that there is no light: {} "
            "pixels, the first {}, {}; expected a part beside them, or another flat-field",
            setup.printer.name, lit.columns[0], p.x, p.y));
      }
      throw InfeasibleError(fmt::format(
          "the light of printer '{}' is too uneven for this part: it fails at {} of its pixels, "
          "the dimmest {}, {}, which gets {}: {}",
          setup.printer.name, pixels, p.x, p.y, share_in_words(map, value), text));
    }
    all_layers_ =
        std::max(all_layers_, slices_with_burst(models_.model(value), layers_, lit.end[v] - 1));
  }
}

const CorrectionPlan& PlacePlans::plan(std::uint8_t value) const {
  const std::lock_guard lock(making_[value]);
  auto& made = plans_[value];
  if (!made) {
    made = std::make_unique<const CorrectionPlan>(models_.model(value), process_, layers_,
                                                  all_layers_);
  }
  return *made;
}

BandReader GroupedBand::Group::reader(std::size_t source) const {
  return [this, source](const SliceSource::Sink& sink) {
    const BandTape& tape = sources[source];
    std::vector<std::uint8_t> rows(columns.size());
    for (int n = 0; n < tape.slices(); ++n) {
      if (tape.black(n)) {
        sink(n, nullptr);
        continue;
      }
      tape.read(n, rows.data());
      sink(n, rows.data());
    }
  };
}

GroupedBand::GroupedBand(const LightMap& map, const PixelBox& band,
                         const std::vector<BandReader>& readers) {
  const std::size_t columns = columns_of(band);
  std::vector<std::uint8_t> lit(columns, 0), rows(columns), gathered(columns);
  std::vector<BandTape> whole;
  for (const BandReader& read : readers) {
    BandTape tape(columns);
    read([&](int, const std::uint8_t* layer) {
      tape.append(layer);
      for (std::size_t k = 0; layer && k < columns; ++k) lit[k] |= layer[k];
    });
    whole.push_back(std::move(tape));
  }
  for (LightGroup& g : light_groups(map, band, lit.data())) {
    groups.push_back({g.value, std::move(g.columns), {}});
  }
  for (const BandTape& tape : whole) {
    for (Group& g : groups) g.sources.emplace_back(g.columns.size());
    for (int n = 0; n < tape.slices(); ++n) {
      const bool black = tape.black(n);
      if (!black) tape.read(n, rows.data());
      for (Group& g : groups) {
        if (!black) {
          for (std::size_t k = 0; k < g.columns.size(); ++k) gathered[k] = rows[g.columns[k]];
        }
        g.sources.back().append(black ? nullptr : gathered.data());
      }
    }
  }
}

Prediction whole_image(const Prediction& in_groups, const PlaceModels& models, const Grid& grid,
                       int slices, const LightCounts& in_all_groups, const ShownSlices* recorded) {
  // Columns without light of the part get that of black: only the brightest matters.
  const LightCounts display = models.map().counts({0, 0, grid.width_px, grid.height_px});
  Prediction sum;
  for (std::size_t v = 256; v-- > 0;) {
    if (display[v] <= in_all_groups[v]) continue;
    sum = black_columns(models.model(static_cast<std::uint8_t>(v)), slices,
                        display[v] - in_all_groups[v], recorded);
    break;
  }
  sum.layers = slices;
  sum.layerwise = layerwise_figures(models.brightest());
  sum.layer_um = grid.layer_um;
  sum.pixel_x_um = grid.pixel_x_um;
  sum.pixel_y_um = grid.pixel_y_um;
  sum.merge(in_groups);
  return sum;
}

void PlaceWindows::merge(std::uint8_t value, const WindowWatch& band) {
  auto& total = totals_[value];
  if (!total) total = std::make_unique<WindowTotal>(models_.model(value), slices_);
  total->merge(band);
}

DeadZones PlaceWindows::result() const {
  DeadZones all;
  const double none = std::numeric_limits<double>::quiet_NaN();
  all.least_um.assign(static_cast<std::size_t>(slices_), none);
  all.greatest_um = all.least_um;
  for (const auto& total : totals_) {
    if (!total) continue;
    const DeadZones one = total->result();
    for (std::size_t n = 0; n < all.least_um.size(); ++n) {
      // fmin and fmax leave out what is NaN.
      all.least_um[n] = std::fmin(all.least_um[n], one.least_um[n]);
      all.greatest_um[n] = std::fmax(all.greatest_um[n], one.greatest_um[n]);
    }
    all.cured_pixels += one.cured_pixels;
    if (one.cured_slice >= 0 && (all.cured_slice < 0 || one.cured_slice < all.cured_slice)) {
      all.cured_slice = one.cured_slice;
    }
  }
  return all;
}

std::vector<double> PlaceWindows::greatest_mw_cm2() const {
  std::vector<double> greatest(static_cast<std::size_t>(slices_), 0.0);
  for (std::size_t v = 0; v < totals_.size(); ++v) {
    if (!totals_[v]) continue;
    const auto value = static_cast<std::uint8_t>(v);
    const std::vector<double> blue = level_intensities(models_.printer_at(value));
    const std::vector<std::uint8_t>& brightest = totals_[v]->brightest();
    for (std::size_t n = 0; n < greatest.size(); ++n) {
      const int level = level_of_pixel(brightest[n], static_cast<int>(blue.size()));
      greatest[n] = std::max(greatest[n], blue[static_cast<std::size_t>(level)]);
    }
  }
  return greatest;
}

}  // namespace slicecorr::detail
