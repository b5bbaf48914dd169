// tune.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <memory>

#include "commands.hpp"
#include "slicecorr/cure.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/load_printer.hpp"
#include "slicecorr/resins/tune.hpp"
#include "slicecorr/stack.hpp"
#include "support/toml/toml_table.hpp"

namespace slicecorr::resinctl {

namespace {

using namespace resins;

struct Arguments {
  std::vector<std::string> tables;
  std::string printer, resin, printed, output;
  double sigma_um = 10;
};

/// Light of the column that was measured, as the stack shows it.
void take_light(TuningTable& table, const std::string& path, const Printer& printer,
                const ExecutionContext& context) {
  const StackReader stack(path, cli::folder_of(path), context);
  const StackInfo& info = stack.info();
  if (info.kind != StackKind::corrected || !info.process) {
    throw InputError(path, "", "is no corrected stack; expected the one that was printed");
  }
  const Grid& g = stack.grid();
  if (std::abs(g.layer_um - table.part.layer_um) > 1e-6 * g.layer_um || table.x_px >= g.width_px ||
      table.y_px >= g.height_px || g.width_px != table.width_px || g.height_px != table.height_px) {
    throw InputError(path, "",
                     fmt::format("has {} x {} pixels and slices of {:g} um, the part of {} {} x {} "
                                 "and {:g} um; expected that part, corrected",
                                 g.width_px, g.height_px, g.layer_um, table.part.source,
                                 table.width_px, table.height_px, table.part.layer_um));
  }
  const std::vector<double> levels = level_intensities(printer);
  table.part.process = *info.process;
  stack.read_band({table.x_px, table.y_px, table.x_px + 1, table.y_px + 1},
                  [&](int, const std::uint8_t* row) {
                    const int level = row ? level_of_pixel(*row, printer.levels()) : 0;
                    table.part.intensity_mw_cm2.push_back(levels[static_cast<std::size_t>(level)]);
                  });
}

/// Gain of measuring each part (again) after this, most first.
std::string next_parts(const std::vector<MeasuredPart>& parts, const Printer& printer,
                       const Resin& resin, const TuneResult& found, double sigma_um) {
  std::vector<std::pair<double, std::string>> gains;
  for (const MeasuredPart& part : parts) {
    std::vector<TuneVector> by, there;
    const std::vector<double> z = predict_edges(part, printer, resin, found.x, &by);
    for (std::size_t i = 0; i < z.size(); ++i) {
      if (z[i] > 0) there.push_back(by[i]);
    }
    gains.emplace_back(gain_of(found.covariance, there, sigma_um).nat, part.source);
  }
  std::sort(gains.rbegin(), gains.rend());
  std::string out;
  for (const auto& [nat, name] : gains) {
    out += fmt::format("next: the part of {} once more, {:.2f} nat\n", name, nat);
  }
  return out;
}

int tune_command(const Arguments& a, const ExecutionContext& context) {
  std::vector<std::string> inputs = a.tables;
  const std::string resin_path = find_definition(a.resin, "resin");
  inputs.insert(inputs.end(), {resin_path, a.printer, a.printed});
  cli::check_output(a.output, inputs);
  const Printer printer = load_printer(a.printer);
  const std::string text = read_text_file(resin_path);
  const Resin resin = parse_resin(text, resin_path);
  std::vector<MeasuredPart> parts;
  for (const std::string& path : a.tables) {
    TuningTable table = read_tuning_table(path);
    if (table.kind == "comb") {
      if (a.printed.empty()) {
        throw InputError(path, "", "is of a print; name the corrected stack by --printed");
      }
      take_light(table, a.printed, printer, context);
    }
    parts.push_back(std::move(table.part));
  }
  const TunePrior prior = prior_of(text, resin_path);
  const TuneResult found = tune(parts, printer, resin, prior, a.sigma_um);
  if (!a.output.empty()) {
    cli::write_text_file(a.output, resin_with_tuning(text, resin_path, found));
  }
  cli::print_result(found.to_text(resin, prior) +
                    next_parts(parts, printer, resin, found, a.sigma_um));
  return cli::kDone;
}

}  // namespace

void add_tune(cli::Program& program) {
  const auto a = std::make_shared<Arguments>();
  CLI::App* sub = program.add(
      "tune", "Find what resin and light really are from test parts that were measured",
      [a](const ExecutionContext& context, cli::Console&) { return tune_command(*a, context); });
  sub->add_option("MEASURED", a->tables, "Tables of slicecorr testpart comb or staircase (.csv)")
      ->required();
  sub->add_option("--printer", a->printer, "Printer: a .toml file or a name")->required();
  sub->add_option("--resin", a->resin, "Resin as it was known: a .toml file or a name")->required();
  sub->add_option("--printed", a->printed, "Combs: the corrected stack that was printed");
  sub->add_option("--sigma-um", a->sigma_um, "Standard deviation of what was measured")
      ->check(cli::number_in(0.01, 1000))
      ->capture_default_str();
  sub->add_option("-o,--output", a->output, "Resin file to write (.toml)");
  sub->footer(
      "Example:\n  resinctl tune comb.csv stairs.csv --printer my-printer.toml --resin "
      "my-resin.toml --printed print.uvj -o tuned.toml");
}

}  // namespace slicecorr::resinctl
