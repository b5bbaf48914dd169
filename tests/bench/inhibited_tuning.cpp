// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Prints the tables of docs/inhibition.md: what happens to corrected columns when one of the
// numbers of the correction under UV light (correct/inhibited_tuning.hpp) is halved or doubled.
// Takes the names of numbers to try [all]; about half an hour for all of them.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <ctime>
#include <functional>
#include <random>
#include <set>
#include <string>
#include <vector>

#include "correct/column_band.hpp"
#include "correct/inhibited_column.hpp"
#include "models.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/load_printer.hpp"
#include "slicecorr/mesh.hpp"
#include "slicecorr/predict.hpp"
#include "slicecorr/slice.hpp"

namespace {

using namespace slicecorr;
using detail::InhibitedTuning;
using Column = std::vector<std::uint8_t>;

constexpr double kLayerUm = 50;
constexpr std::size_t kColumnsOfEach = 150;
constexpr std::array<double, 2> kFactors{0.5, 2.0};
constexpr std::array kSets{"of these: 4 to 24 slices", "1 to 6 slices", "3DBenchy", "lattice"};

// The numbers, each with what "half" and "double" mean for it.

struct Number {
  std::string name;
  std::function<void(InhibitedTuning&, double factor)> scale;
  std::function<std::string(const InhibitedTuning&)> text;
};

double scaled(double value, double factor) { return value * factor; }
int scaled(int value, double factor) {
  return std::max(1, static_cast<int>(std::lround(value * factor)));
}
std::size_t scaled(std::size_t value, double factor) {
  return static_cast<std::size_t>(static_cast<double>(value) * factor);
}
InhibitedTuning::Fraction scaled(InhibitedTuning::Fraction share, double factor) {
  return factor < 1 ? InhibitedTuning::Fraction{share.times, 2 * share.over}
                    : InhibitedTuning::Fraction{2 * share.times, share.over};
}
template <typename T, std::size_t N>
std::array<T, N> scaled(std::array<T, N> values, double factor) {
  for (T& value : values) value = scaled(value, factor);
  return values;
}

template <typename T>
std::string text_of(const T& value) {
  return fmt::format("{}", value);
}
std::string text_of(double value) { return fmt::format("{:g}", value); }
std::string text_of(InhibitedTuning::Fraction share) {
  const int common = share.times % 2 == 0 && share.over % 2 == 0 ? 2 : 1;
  if (share.over == common) return fmt::format("{}", share.times / common);
  return fmt::format("{}/{}", share.times / common, share.over / common);
}
template <typename T, std::size_t N>
std::string text_of(const std::array<T, N>& values) {
  std::string text;
  for (const T& value : values) {
    if (!text.empty()) text += ' ';
    text += text_of(value);
  }
  return text;
}

template <typename T>
Number number(std::string name, T InhibitedTuning::*field) {
  return {std::move(name),
          [field](InhibitedTuning& t, double factor) { t.*field = scaled(t.*field, factor); },
          [field](const InhibitedTuning& t) { return text_of(t.*field); }};
}
/// A dose near 1, of which the distance to 1 is halved or doubled.
Number near_gel(std::string name, double InhibitedTuning::*field) {
  return {
      std::move(name),
      [field](InhibitedTuning& t, double factor) { t.*field = 1.0 + factor * (t.*field - 1.0); },
      [field](const InhibitedTuning& t) { return text_of(t.*field); }};
}

std::vector<Number> numbers() {
  using T = InhibitedTuning;
  return {
      near_gel("inside_dose", &T::inside_dose),
      near_gel("slit_edge_dose", &T::slit_edge_dose),
      near_gel("slit_inner_dose", &T::slit_inner_dose),
      number("lag_shares", &T::lag_shares),
      number("layerwise_lag_shares", &T::layerwise_lag_shares),
      number("lags_in_vain", &T::lags_in_vain),
      number("end_lag_share", &T::end_lag_share),
      number("spare_slices", &T::spare_slices),
      number("settled_lengths", &T::settled_lengths),
      number("calm_levels", &T::calm_levels),
      number("own_lag_features", &T::own_lag_features),
      number("tolerance_um", &T::tolerance_um),
      number("most_edge_layers", &T::most_edge_layers),
      number("grown_voxel_layers", &T::grown_voxel_layers),
      number("lost_voxel_layers", &T::lost_voxel_layers),
      number("split_layers", &T::split_layers),
      number("split_depth_layers", &T::split_depth_layers),
      number("most_split_depth_layers", &T::most_split_depth_layers),
      number("raise_rounds", &T::raise_rounds),
      number("raise_rounds_inside", &T::raise_rounds_inside),
      number("raise_extra_dose", &T::raise_extra_dose),
      number("raise_growth", &T::raise_growth),
      number("polish_sweeps", &T::polish_sweeps),
      number("polish_steps", &T::polish_steps),
      number("polish_moves", &T::polish_moves),
      number("polish_enough", &T::polish_enough),
      number("polish_least_gain", &T::polish_least_gain),
      number("edge_weight", &T::edge_weight),
      near_gel("core_dose", &T::core_dose),
      number("core_weight", &T::core_weight),
      near_gel("excess_dose", &T::excess_dose),
      number("excess_weight", &T::excess_weight),
      near_gel("gap_dose", &T::gap_dose),
      number("gap_weight", &T::gap_weight),
      near_gel("dip_dose", &T::dip_dose),
      number("dip_weights", &T::dip_weights),
  };
}

// The columns: random ones, and those of real parts.

std::vector<Column> random_columns(unsigned least, unsigned most, unsigned seed) {
  std::mt19937 random(seed);
  std::vector<Column> columns(kColumnsOfEach);
  for (Column& column : columns) {
    std::uint8_t coverage = random() % 2 ? 255 : 0;
    while (column.size() < 120) {
      column.insert(column.end(), least + random() % (most - least + 1), coverage);
      coverage = static_cast<std::uint8_t>(255 - coverage);
    }
    column.resize(120);
  }
  return columns;
}

/// Columns of a part that differ, evenly picked.
std::vector<Column> part_columns(const std::string& name, double scale, const Printer& printer) {
  Placement placement;
  placement.scale = scale;
  const std::string path = std::string(SLICECORR_TEST_DATA) + "/meshes/clean/" + name;
  const MeshSlices slices(read_mesh(path, placement), printer, {kLayerUm, false, {}, {}});
  const auto layers = static_cast<std::size_t>(slices.grid().layers);
  const PixelBox box = slices.bounds();
  const auto pixels =
      static_cast<std::size_t>(box.width()) * static_cast<std::size_t>(box.height());
  std::vector<Column> all(pixels, Column(layers, 0));
  slices.read_band(box, [&](int n, const std::uint8_t* rows) {
    for (std::size_t i = 0; rows && i < pixels; ++i) all[i][static_cast<std::size_t>(n)] = rows[i];
  });
  std::set<std::string> different;  // compared byte by byte, as columns are
  for (const Column& c : all) different.emplace(c.begin(), c.end());
  std::vector<Column> list;
  for (const std::string& c : different) list.emplace_back(c.begin(), c.end());
  if (list.size() < kColumnsOfEach) throw Error("too few different columns in " + path);
  std::vector<Column> picked;
  for (std::size_t i = 0; i < kColumnsOfEach; ++i) {
    picked.push_back(list[i * list.size() / kColumnsOfEach]);
  }
  return picked;
}

std::vector<detail::CoverageRun> runs_of(const Column& column) {
  std::vector<detail::CoverageRun> runs;
  const auto layers = static_cast<std::int32_t>(column.size());
  for (std::int32_t n = 0; n < layers; ++n) {
    if (column[static_cast<std::size_t>(n)] == 0) continue;
    if (runs.empty() || runs.back().end != n) runs.push_back({n, n, 255});
    runs.back().end = n + 1;
  }
  return runs;
}

// The measurement.

struct Figures {
  Prediction prints;
  double cpu_s = 0;          ///< of the solve
  double shipped_cpu_s = 0;  ///< of the solve with the numbers as shipped, measured in turn
  std::vector<std::vector<std::uint8_t>> levels;

  std::uint64_t broken() const { return prints.split_features + prints.lost_features; }
};

double cpu_s() { return static_cast<double>(std::clock()) / CLOCKS_PER_SEC; }

using Levels = std::vector<std::vector<std::uint8_t>>;

/// Solves columns; returns the processor time, s.
double solve(detail::InhibitedColumn& solver, const std::vector<Column>& columns, Levels& levels) {
  levels.clear();
  const double start = cpu_s();
  for (const Column& column : columns) levels.push_back(solver.solve(runs_of(column)));
  return cpu_s() - start;
}

/// Solves and predicts columns of equal height.
void measure(const CureModel& model, const std::vector<Column>& columns,
             const InhibitedTuning& tuning, Figures& figures) {
  const int layers = static_cast<int>(columns.front().size());
  const auto plan_for = [&](const InhibitedTuning& t) {
    const int slices = detail::InhibitedPlan(model, false, 1, 1, t).slices_for(layers, layers - 1);
    return detail::InhibitedPlan(model, false, layers, slices, t);
  };
  const detail::InhibitedPlan plan = plan_for(tuning), shipped = plan_for({});
  detail::InhibitedColumn solver(plan), shipped_solver(shipped);
  Levels levels, as_shipped;
  // The least of a few turns: the first fills tables, and the machine has other work.
  double least_s = 1e300, shipped_s = 1e300;
  for (int turn = 0; turn < 3; ++turn) {
    shipped_s = std::min(shipped_s, solve(shipped_solver, columns, as_shipped));
    least_s = std::min(least_s, solve(solver, columns, levels));
  }
  figures.cpu_s += least_s;
  figures.shipped_cpu_s += shipped_s;
  const PixelCurve curve = pixel_curve(model);
  BandPredictor predictor(model, curve, plan.all_layers, columns.size());
  Column shown(columns.size()), coverage(columns.size());
  for (int n = plan.all_layers; n-- > 0;) {
    for (std::size_t i = 0; i < columns.size(); ++i) {
      shown[i] = levels[i][static_cast<std::size_t>(n)];
      coverage[i] = n < layers ? columns[i][static_cast<std::size_t>(n)] : std::uint8_t{0};
    }
    predictor.add_slice(n, shown.data(), coverage.data());
  }
  figures.prints.merge(predictor.finish(0, 0, static_cast<int>(columns.size())));
  for (auto& column : levels) {
    column.resize(static_cast<std::size_t>(layers));
    figures.levels.push_back(std::move(column));
  }
}

Figures measure(const CureModel& model, const std::vector<std::vector<Column>>& sets,
                const InhibitedTuning& tuning) {
  Figures figures;
  for (const auto& columns : sets) measure(model, columns, tuning, figures);
  return figures;
}

void print_row(const std::string& name, const std::string& value, const std::string& tried,
               const std::vector<Figures>& figures) {
  const auto cell = [&](const auto& text) {
    std::string joined;
    for (const Figures& f : figures) joined += (joined.empty() ? "" : ", ") + text(f);
    return joined;
  };
  fmt::print(
      "| {} | {} | {} | {} | {} | {} | {} | {} | {} |\n", name, value, tried,
      cell([](const Figures& f) { return fmt::format("{:.2f}", f.prints.height_error_um.mean()); }),
      cell([](const Figures& f) {
        return fmt::format("{:.0f}", f.prints.height_error_um.greatest());
      }),
      cell([](const Figures& f) { return fmt::format("{}", f.broken()); }),
      cell([](const Figures& f) { return fmt::format("{}", f.prints.undercure_voxels); }),
      cell([](const Figures& f) { return fmt::format("{}", f.prints.cure_through_voxels); }),
      cell([](const Figures& f) { return fmt::format("{:.2f}", f.cpu_s / f.shipped_cpu_s); }));
  std::fflush(stdout);
}

void print_table(const CureModel& model, const std::vector<std::vector<Column>>& sets,
                 const std::set<std::string>& only) {
  const InhibitedTuning shipped;
  const Figures before = measure(model, sets, shipped);
  fmt::print(
      "\n| number | value | halved, doubled | mean error (um) | largest (um) | split or lost | "
      "undercured | cured through | time |\n|---|---|---|---|---|---|---|---|---|\n");
  print_row("as shipped", "", "", {before});
  for (std::size_t i = 0; i < sets.size(); ++i) {
    print_row(kSets[i], "", "", {measure(model, {sets[i]}, shipped)});
  }
  std::string idle;
  for (const Number& number : numbers()) {
    if (!only.empty() && !only.contains(number.name)) continue;
    std::vector<Figures> figures;
    std::string tried;
    bool changes = false;
    for (const double factor : kFactors) {
      InhibitedTuning tuning;
      number.scale(tuning, factor);
      figures.push_back(measure(model, sets, tuning));
      tried += (tried.empty() ? "" : ", ") + number.text(tuning);
      changes = changes || figures.back().levels != before.levels;
    }
    if (changes) {
      print_row(number.name, number.text(shipped), tried, figures);
    } else {
      idle += (idle.empty() ? "`" : ", `") + number.name + "`";
    }
  }
  if (!idle.empty()) fmt::print("\nNo level changes with {}.\n", idle);
  fmt::print("{} runs, {} voxels, {:.2f} s\n", before.prints.runs, before.prints.target_voxels,
             before.cpu_s);
}

/// Seconds of a band of all of a part's columns: what keeping solved columns saves.
double band_s(const CureModel& model, const SliceSource& part, std::size_t kept_bytes) {
  InhibitedTuning tuning;
  tuning.kept_bytes = kept_bytes;
  const int layers = part.grid().layers;
  const int slices = detail::InhibitedPlan(model, false, 1, 1).slices_for(layers, layers - 1);
  const detail::InhibitedPlan plan(model, false, layers, slices, tuning);
  const PixelBox box = part.bounds();
  detail::ColumnBand band(
      std::make_unique<detail::InhibitedColumn>(plan), plan.facts(),
      static_cast<std::size_t>(box.width()) * static_cast<std::size_t>(box.height()));
  part.read_band(box,
                 [&](int, const std::uint8_t* rows) { band.add_layer(rows, nullptr, nullptr); });
  const double start = cpu_s();
  band.solve([](int, const std::uint8_t*, const std::uint8_t*, bool) {}, {});
  return cpu_s() - start;
}

}  // namespace

int main(int argc, char** argv) {
  const std::set<std::string> only(argv + 1, argv + argc);
  const Printer printer =
      load_printer(SLICECORR_SOURCE_DIR "/resins/printers/dual-wavelength-dlp.toml");
  const Resin resin = load_resin(SLICECORR_SOURCE_DIR "/resins/db/custom-resin-1.toml");
  const std::vector<std::vector<Column>> sets{random_columns(4, 24, 1), random_columns(1, 6, 2),
                                              part_columns("3DBenchy.stl", 0.25, printer),
                                              part_columns("tpms_diamond_51.stl", 15, printer)};
  Process process;
  process.uv.kind = UvKind::constant;
  process.uv.uv_mw_cm2 = 200;
  process.speed_mm_h = 200;
  const CureModel continuous = make_cure_model(printer, resin, process, kLayerUm);
  process.speed_mm_h = 0;
  process.mode = ExposureMode::layerwise;
  process.exposure_s = 5;
  const CureModel layerwise = make_cure_model(printer, resin, process, kLayerUm);
  for (const CureModel* model : {&continuous, &layerwise}) print_table(*model, sets, only);

  Placement quarter;
  quarter.scale = 0.25;
  const MeshSlices boat(read_mesh(SLICECORR_TEST_DATA "/meshes/clean/3DBenchy.stl", quarter),
                        printer, {kLayerUm, false, {}, {}});
  const std::size_t kept = InhibitedTuning{}.kept_bytes;
  for (const std::size_t bytes : {kept, kept / 16, kept / 256, std::size_t{1}}) {
    fmt::print("kept_bytes {}: {:.2f} s\n", bytes, band_s(continuous, boat, bytes));
  }
  return 0;
}
