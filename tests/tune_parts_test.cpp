// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Closed loop: a made up printer whose parameters are 10 % off, combs measured to 10 um, and what
// the parts of docs/baselines.md then print, beside what perfect knowledge prints.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>

#include "models.hpp"
#include "real_files.hpp"
#include "rounds.hpp"
#include "slicecorr/mesh.hpp"
#include "slicecorr/resins/tune.hpp"
#include "slicecorr/slice.hpp"
#include "slicecorr/tuning_part.hpp"

namespace slicecorr::resins {
namespace {

/// A run of full layers, [first, past).
using Runs = std::vector<std::pair<int, int>>;

struct Part {
  const char *name, *mesh;
  double dc_mj_cm3, ha_um, speed_mm_h;
  Placement placement;
};

/// As scripts/compare-parts has them.
std::vector<Part> parts() {
  const auto scaled = [](double scale, const Point3& turn = {}) {
    return Placement{Units::mm, scale, turn};
  };
  return {{"3DBenchy", "3DBenchy.stl", 230, 1500, 800, {}},
          {"bunny", "stanford_bunny_7k_closed.off", 173, 2000, 800, scaled(200, {90, 0, 0})},
          {"femur", "cgal_femur.off", 748, 2000, 750, scaled(40)},
          {"turbine", "cgal_turbine.off", 173, 2000, 800, scaled(36)},
          {"diamond lattice", "tpms_diamond_51.stl", 230, 1500, 800, scaled(24)}};
}

const Printer kWorldPrinter = test::linear_printer(1, 100);
constexpr double kSigmaUm = 10;

/// Some columns of a part that is sliced on coarse pixels, in layers of 50 um.
struct Columns {
  int layers = 0;
  std::vector<Runs> runs;
};
Columns columns_of(const Part& part, std::size_t most) {
  Printer coarse = kWorldPrinter;
  coarse.width_px = 128;
  coarse.height_px = 80;
  coarse.pixel_x_um = coarse.pixel_y_um = 500;
  SliceOptions options;
  options.antialias = false;
  const std::string path = test::real_file(std::string("meshes/clean/") + part.mesh);
  const MeshSlices slices(read_mesh(path, part.placement), coarse, options);
  const PixelBox box = slices.bounds();
  std::vector<Runs> all(static_cast<std::size_t>(box.width() * box.height()));
  slices.read_band(box, [&](int n, const std::uint8_t* rows) {
    for (std::size_t i = 0; rows && i < all.size(); ++i) {
      if (rows[i] == 0) continue;
      if (!all[i].empty() && all[i].back().second == n) {
        ++all[i].back().second;
      } else {
        all[i].emplace_back(n, n + 1);
      }
    }
  });
  std::erase_if(all, [](const Runs& r) { return r.empty(); });
  std::mt19937 random(11);
  std::shuffle(all.begin(), all.end(), random);
  if (all.size() > most) all.resize(most);
  return {slices.grid().layers, std::move(all)};
}

/// What is believed, x of the files, or is true.
struct World {
  Resin resin;
  Process process;
};

/// Light of columns that are corrected by what is believed, as the printer's file says it.
std::vector<std::vector<double>> corrected(const World& world, const TuneVector& believed,
                                           const Columns& columns) {
  const Printer printer = tuned_printer(kWorldPrinter, 1, believed);
  const CureModel model =
      make_cure_model(printer, tuned_resin(world.resin, believed), world.process, 50);
  const CorrectionPlan plan(model, world.process, columns.layers,
                            slices_with_burst(model, columns.layers, columns.layers - 1));
  BandCorrector corrector(plan, columns.runs.size());
  std::vector<std::uint8_t> row(columns.runs.size());
  for (int n = 0; n < columns.layers; ++n) {
    for (std::size_t c = 0; c < row.size(); ++c) {
      const Runs& runs = columns.runs[c];
      row[c] = std::any_of(runs.begin(), runs.end(),
                           [&](const auto& r) { return n >= r.first && n < r.second; })
                   ? 255
                   : 0;
    }
    corrector.add_layer(row.data());
  }
  const std::vector<double> levels = level_intensities(kWorldPrinter);
  std::vector<std::vector<double>> light(
      columns.runs.size(), std::vector<double>(static_cast<std::size_t>(plan.all_layers)));
  corrector.solve([&](int n, const std::uint8_t* level, const std::uint8_t*, bool) {
    for (std::size_t c = 0; c < light.size(); ++c) {
      light[c][static_cast<std::size_t>(n)] = levels[level[c]];
    }
  });
  return light;
}

MeasuredPart edges_of(const Runs& runs, const World& world) {
  MeasuredPart part;
  part.process = world.process;
  part.layer_um = 50;
  for (const auto& [first, past] : runs) {
    // The platform is no edge.
    if (first > 0) part.edges.push_back({"begin", MeasuredKind::upper, first * 50.0});
    part.edges.push_back({"end", MeasuredKind::lower, past * 50.0});
  }
  return part;
}

struct Error {
  double mean_um = 0, rms_um = 0;
  std::size_t gone = 0;  ///< edges of features that are lost or have grown together
};
Error error_of(const World& world, const TuneVector& believed, const TuneVector& truth,
               const Columns& columns) {
  const auto light = corrected(world, believed, columns);
  Error error;
  std::size_t count = 0;
  for (std::size_t c = 0; c < columns.runs.size(); ++c) {
    MeasuredPart part = edges_of(columns.runs[c], world);
    part.intensity_mw_cm2 = light[c];
    const std::vector<double> z = predict_edges(part, kWorldPrinter, world.resin, truth);
    for (std::size_t i = 0; i < z.size(); ++i) {
      if (std::isnan(z[i])) {
        ++error.gone;
        continue;
      }
      const double off = z[i] - part.edges[i].designed_um;
      error.mean_um += std::abs(off);
      error.rms_um += off * off;
      ++count;
    }
  }
  error.mean_um /= static_cast<double>(count);
  error.rms_um = std::sqrt(error.rms_um / static_cast<double>(count));
  return error;
}

/// 20 dark, teeth of 10, gaps of 4, 6, 8, 12 and 16.
Columns comb_columns() {
  Columns comb;
  Runs runs;
  int at = 20;
  for (const int gap : {4, 6, 8, 12, 16, 0}) {
    runs.emplace_back(at, at + 10);
    comb.layers = at + 10;
    at += 10 + gap;
  }
  comb.runs = {runs};
  return comb;
}

/// A staircase or wedge for what the files say.
MeasuredPart plugs(const World& world, TuningPartKind kind) {
  Printer printer = kWorldPrinter;
  printer.width_px = 1280;
  printer.height_px = 800;
  TuningPart::Ask ask;
  ask.resin = &world.resin;
  MeasuredPart part;
  const TuningPart plate(kind, printer, ask);
  for (const TuningPart::Row& row : plate.rows()) {
    MeasuredEdge e;
    e.name = row.name;
    e.exposure_s = row.shown_s;
    e.intensity_mw_cm2 = row.intensity_mw_cm2;
    e.dark_s = row.dark_s;
    e.dark_mw_cm2 = row.dark_mw_cm2;
    part.edges.push_back(e);
  }
  return part;
}

double quantile(std::vector<double> values, double q) {
  std::sort(values.begin(), values.end());
  return values[static_cast<std::size_t>(std::lround(q * static_cast<double>(values.size() - 1)))];
}

/// What each run ends with: one figure each before, after one round, after two, and by the truth.
struct Runs4 {
  std::vector<double> mean[4], rms[4];
  std::size_t gone[4] = {};
};

/// `plates`: staircases, and as many wedges, in each round.
Runs4 closed_loop(const Part& part, int combs, int plates, unsigned seeds,
                  std::size_t most_columns) {
  World world;
  world.resin = test::resin(part.dc_mj_cm3, part.ha_um);
  world.process = test::process(part.speed_mm_h);
  const Columns columns = columns_of(part, most_columns), teeth = comb_columns();
  Runs4 all;
  for (const TuneVector& truth : {TuneVector{0.1, 0.1, 0.1}, TuneVector{0.1, -0.1, -0.1},
                                  TuneVector{-0.1, 0.1, 0.1}, TuneVector{-0.1, -0.1, 0.1}}) {
    const Error best = error_of(world, truth, truth, columns);
    for (unsigned seed = 0; seed < seeds; ++seed) {
      std::mt19937 random(seed + 100);
      std::normal_distribution<double> noise(0, kSigmaUm);
      std::vector<MeasuredPart> measured;
      TuneVector believed{};
      const auto note = [&](std::size_t when, const Error& e) {
        all.mean[when].push_back(e.mean_um);
        all.rms[when].push_back(e.rms_um);
        all.gone[when] += e.gone;
      };
      note(0, error_of(world, believed, truth, columns));
      for (std::size_t round = 1; round < 3; ++round) {
        MeasuredPart shown = edges_of(teeth.runs[0], world);
        shown.intensity_mw_cm2 = corrected(world, believed, teeth)[0];
        const auto measure = [&](MeasuredPart what, int times) {
          const std::vector<double> z = predict_edges(what, kWorldPrinter, world.resin, truth);
          for (int n = 0; n < times; ++n) {
            for (std::size_t i = 0; i < z.size(); ++i) {
              what.edges[i].measured_um = z[i] + noise(random);
            }
            measured.push_back(what);
          }
        };
        measure(shown, combs);
        measure(plugs(world, TuningPartKind::staircase), plates);
        measure(plugs(world, TuningPartKind::wedge), plates);
        believed = tune(measured, kWorldPrinter, world.resin, default_prior(), kSigmaUm).x;
        note(round, error_of(world, believed, truth, columns));
      }
      note(3, best);
    }
  }
  return all;
}

void record(const char* part, const char* measured, const Runs4& r) {
  static const char* const whens[] = {"before", "one round", "two rounds", "perfect knowledge"};
  for (std::size_t when = 0; when < 4; ++when) {
    testing::Test::RecordProperty(
        fmt::format("{}, {}, {}", part, measured, whens[when]),
        fmt::format("mean {:.3f} um (nine of ten {:.3f}), rms {:.3f} ({:.3f}), {} gone",
                    quantile(r.mean[when], 0.5), quantile(r.mean[when], 0.9),
                    quantile(r.rms[when], 0.5), quantile(r.rms[when], 0.9), r.gone[when]));
  }
}

// Ten combs, three staircases and three wedges a round: each of the parts prints 5 times better than
// before, in nine runs of ten, and loses nothing more than with perfect knowledge.
TEST(TuneParts, CombsAndPlugs) {
  for (const Part& part : parts()) {
    SLICECORR_NEEDS_FILE(test::real_file(std::string("meshes/clean/") + part.mesh));
    const Runs4 r = closed_loop(part, 10, 3, static_cast<unsigned>(test::rounds(2)), 60);
    record(part.name, "10 combs, 3 plates of each", r);
    EXPECT_LT(quantile(r.mean[2], 0.9), quantile(r.mean[0], 0.5) / 5) << part.name;
    EXPECT_LE(r.gone[2], r.gone[3]) << part.name;
  }
}

// Teeth of half a millimetre don't tell the absorbance height well enough for what is high.
TEST(TunePartsNight, CombsAlone) {
  for (const Part& part : parts()) {
    SLICECORR_NEEDS_FILE(test::real_file(std::string("meshes/clean/") + part.mesh));
    for (const int combs : {1, 10}) {
      const Runs4 r = closed_loop(part, combs, 0, static_cast<unsigned>(test::rounds(2)), 60);
      record(part.name, combs == 1 ? "1 comb" : "10 combs", r);
      if (combs == 10) {
        EXPECT_LT(quantile(r.mean[2], 0.5), quantile(r.mean[0], 0.5) / 3) << part.name;
      }
    }
  }
}

}  // namespace
}  // namespace slicecorr::resins
