// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Labs that have a printer, a resin and calipers, and nothing else: films are measured, printer and
/// resin files are made of them, columns are corrected with these, and what prints is reckoned with what
/// was hidden.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cmath>
#include <numeric>

#include "films_lab.hpp"
#include "lab_columns.hpp"
#include "models.hpp"
#include "rounds.hpp"
#include "slicecorr/correct.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/films_part.hpp"
#include "slicecorr/measuring_form.hpp"
#include "slicecorr/resins/films_fit.hpp"
#include "slicecorr/unmeasured_light.hpp"
#include "stack_fixture.hpp"

namespace slicecorr::resins {
namespace {

constexpr double kLayerUm = 50;

/// The films of a lab, measured by calipers that are up to `off_um` off.
FilmsFit calibrated(const test::HiddenPrinter& hidden, double off_um, std::mt19937& random,
                    const test::TemporaryFolder& folder) {
  const Printer dark = parse_display(test::kUnlitPrinter, "dark.toml");
  FileGreys greys;
  for (std::size_t i = 0; i < greys.size(); ++i) greys[i] = static_cast<std::uint8_t>(i);
  const FilmsPart part(dark, greys, {});
  MeasuringForm form = part.form();
  for (std::size_t i = 0; i < form.rows.size(); ++i) {
    const FilmSquare& s = part.squares()[i];
    const double um =
        test::read_by_calipers(hidden.film_um(s.level, part.exposure_s(s)), off_um, random);
    if (um > 0) form.rows[i].push_back(fmt::format("{:.4f}", um));
  }
  test::write_file(folder / "films.csv", test::to_bytes(form_text(form)));
  return fit_films(read_films(folder / "films.csv", dark), dark);
}

/// Where the edge above node u comes to lie, um (test::lab_edge_um).
double edge_um(const test::HiddenPrinter& hidden, const std::vector<std::uint8_t>& levels,
               double exposure_s, int u, double x) {
  std::vector<double> phi;
  for (const std::uint8_t g : levels) phi.push_back(hidden.share[g] * exposure_s / hidden.gel_s);
  return test::lab_edge_um(phi, hidden.ha_um, kLayerUm, u, x);
}

/// How far the worst edge of a random part lies from its place, and how far it may with films that are exact:
/// light between measured levels is taken for straight, and a part is shown in whole levels.
struct Edges {
  double worst_um = 0, may_um = 0;
};
Edges edges_of(const test::HiddenPrinter& hidden, const FilmsFit& fit, double exposure_s, double x,
               std::mt19937& random) {
  const Printer printer = parse_printer(
      printer_with_films(test::kUnlitPrinter, "dark.toml", "mine", fit, 0), "mine.toml");
  const Resin resin = parse_resin(resin_of_films("mine", printer, fit, 0), "mine.toml");
  Process process;
  process.mode = ExposureMode::layerwise;
  process.exposure_s = exposure_s;
  process.lifts = Lifts::each;
  process.lift_exchange = x;
  const CureModel model = make_cure_model(printer, resin, process, kLayerUm);
  const test::LabColumn part = test::random_lab_column(random);
  const int layers = static_cast<int>(part.coverage.size());
  const std::vector<std::uint8_t> levels =
      solve_column(CorrectionPlan{model, process, layers, layers}, part.coverage);
  Edges edges;
  for (const int u : part.begins) {
    edges.worst_um = std::max(edges.worst_um, std::abs(edge_um(hidden, levels, exposure_s, u, x)));
  }
  const std::vector<double> taken = level_intensities(printer);
  double off = 0, step = 0;
  for (const std::uint8_t g : levels) {
    if (g == 0 || g == 255) continue;
    off = std::max(off, std::abs(taken[g] / hidden.share[g] - 1));
    step = std::max(step, hidden.share[g + 1u] / hidden.share[g] - 1);
  }
  edges.may_um = hidden.ha_um * std::log10((1 + off) * (1 + step)) + kLayerUm / test::kLabPoints;
  return edges;
}

struct Labs {
  int count = 0, good = 0;
  std::vector<Edges> edges;
};

/// `off_um`: of calipers.
Labs labs(int count, double off_um, unsigned seed) {
  std::mt19937 random(seed);
  const test::TemporaryFolder folder;
  Labs all;
  while (all.count < count) {
    const auto hidden = test::HiddenPrinter::random(random);
    const FilmsFit fit = calibrated(hidden, off_um, random, folder);
    // As bright as people expose: full light has 6 to 12 times what gels a surface.
    const double exposure_s = hidden.gel_s * std::uniform_real_distribution(6., 12.)(random);
    const double x = std::array{0.0, 0.3, 1.0}[random() % 3];
    const Edges edges = edges_of(hidden, fit, exposure_s, x, random);
    ++all.count;
    all.good += edges.worst_um <= 15;
    all.edges.push_back(edges);
  }
  return all;
}

// What is left without any error of calipers is that of levels between those that were measured, and of
// grey levels themselves.
TEST(CalipersLab, ExactFilmsPlaceEdges) {
  const Labs all = labs(test::rounds(10), 0, 3);
  for (const Edges& e : all.edges) EXPECT_LE(e.worst_um, e.may_um);
}

// Calipers that are anywhere within 10 um off, and show steps of 10 um: edges of a part lie within 15 um of
// their places in 95 % of labs.
TEST(CalipersLab, EdgesLieWithinFifteenMicrometres) {
  const Labs all = labs(test::rounds(40), 10, 4);
  RecordProperty("labs", all.count);
  RecordProperty("good", all.good);
  std::vector<double> worst;
  for (const Edges& e : all.edges) worst.push_back(e.worst_um);
  std::sort(worst.begin(), worst.end());
  RecordProperty("um_of_95_percent",
                 fmt::format("{:.1f}", worst[static_cast<std::size_t>(0.95 * all.count)]));
  EXPECT_GE(all.good, std::floor(0.95 * all.count));
}

}  // namespace
}  // namespace slicecorr::resins
