// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// list.
#include <fmt/format.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>

#include "commands.hpp"
#include "describe.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/light_unit.hpp"
#include "slicecorr/load_display.hpp"
#include "slicecorr/resins/database.hpp"
#include "slicecorr/resins/exchange.hpp"
#include "slicecorr/resins/search.hpp"
#include "slicecorr/same_light.hpp"
#include "slicecorr/unmeasured_light.hpp"
#include "support/json/read_json.hpp"

namespace slicecorr::resinctl {

namespace {

using namespace resins;
using cli::Console;
using nlohmann::ordered_json;

struct ListArguments {
  std::vector<std::string> words;
  std::string maker, chemistry, height_um, printer, json;
  double wavelength_nm = 0;
  bool printers = false;
};

/// LOW:HIGH; either side may be empty.
void set_heights(const std::string& text, Query& query) {
  if (text.empty()) return;
  const std::size_t colon = text.find(':');
  const auto side = [&](const std::string& part) -> std::optional<double> {
    if (part.empty()) return std::nullopt;
    const auto value = cli::number_of(part);
    if (!value || *value < 0) {
      throw InputError(fmt::format(
          "--height-um {}: expected LOW:HIGH, such as 100:300 or :50, in um, base e", text));
    }
    return value;
  };
  if (colon == std::string::npos) side("-");
  query.least_height_um = side(text.substr(0, colon));
  query.greatest_height_um = side(text.substr(colon + 1));
  if (query.least_height_um && query.greatest_height_um &&
      *query.least_height_um > *query.greatest_height_um) {
    throw InputError(fmt::format("--height-um {}: LOW is above HIGH", text));
  }
}

/// Where stdout is a terminal too narrow for the rows, without their last columns: first the file.
std::vector<std::vector<std::string>> fitting(std::vector<std::vector<std::string>> rows,
                                              Console& console) {
  winsize size{};
  if (::ioctl(STDOUT_FILENO, TIOCGWINSZ, &size) != 0 || size.ws_col == 0) return rows;
  const auto widest = [&] {
    const std::string text = aligned(rows);
    std::size_t most = 0;
    for (std::size_t at = 0; at < text.size();) {
      const std::size_t end = std::min(text.find('\n', at), text.size());
      most = std::max(most, end - at);
      at = end + 1;
    }
    return most;
  };
  const std::size_t all = rows.front().size();
  while (rows.front().size() > 2 && widest() > size.ws_col) {
    for (auto& row : rows) row.pop_back();
  }
  if (rows.front().size() < all) {
    console.say("(the window is too narrow for all columns; --json - has them)");
  }
  return rows;
}

void put_list(const std::string& json, const ordered_json& list,
              const std::vector<std::vector<std::string>>& rows, const char* what,
              Console& console) {
  if (json.empty()) {
    cli::print_result(aligned(fitting(rows, console)));
  } else {
    cli::print_or_write(json, list.dump(2));
  }
  const std::size_t n = rows.size() - 1;
  console.say(fmt::format("{} {}{}", n, what, n == 1 ? "" : "s"));
}

/// The light of a printer, as far as somebody measured it.
std::string light_text(const Printer& p) {
  if (!light_is_measured(p)) return std::string(kToBeMeasured);
  return fmt::format("{:g} to {:g}{}", p.calibration.front().intensity_mw_cm2,
                     p.calibration.back().intensity_mw_cm2, is_relative(p) ? " of full" : "");
}

int list_printers(const ListArguments& a, const std::string& words, Console& console) {
  if (!a.maker.empty() || !a.chemistry.empty() || !a.height_um.empty() || !a.printer.empty()) {
    throw InputError("--maker, --chemistry, --height-um and --for are for resins");
  }
  std::vector<std::vector<std::string>> rows = {
      {"NAME", "PIXELS", "UM", "NM", "MW/CM²", "UV MW/CM²", "VIAL MM", "FILE"}};
  auto list = ordered_json::array();
  for (const Definition& d : list_definitions("printer")) {
    try {
      const Printer p = load_display(d.path);
      std::vector<std::string> texts = searched_texts_of_printer(d.path);
      texts.push_back(d.name);
      const bool fits = a.wavelength_nm == 0 ||
                        (p.wavelength_nm > 0 && same_light(p.wavelength_nm, a.wavelength_nm));
      if (!fits || !words_occur(words, texts)) continue;
      rows.push_back(
          {d.name, fmt::format("{} x {}", p.width_px, p.height_px),
           p.pixel_x_um == p.pixel_y_um ? fmt::format("{:g}", p.pixel_x_um)
                                        : fmt::format("{:g} x {:g}", p.pixel_x_um, p.pixel_y_um),
           p.wavelength_nm > 0 ? fmt::format("{:g}", p.wavelength_nm) : "-", light_text(p),
           p.uv ? fmt::format("{:g} to {:g}", p.uv->min_mw_cm2(), p.uv->max_mw_cm2()) : "-",
           p.vial ? fmt::format("{:g}", 2 * p.vial->inner_mm) : "-", d.path});
      list.push_back(slicecorr::detail::own_json<nlohmann::ordered_json>(printer_json(p, d.path)));
    } catch (const Error& e) {
      console.say(e.what());
    }
  }
  put_list(a.json, list, rows, "printer", console);
  return cli::kDone;
}

/// Those that do not go with a printer, by the reason.
struct LeftOut {
  int wavelength = 0, unit = 0, tuned = 0;
  std::set<double> wavelengths_nm;
};

/// Takes out what does not go with the printer; the others by how near their wavelength is, those that
/// say none last.
LeftOut keep_what_goes(const Printer& printer, std::vector<ResinRecord>& records) {
  LeftOut left;
  std::vector<ResinRecord> kept;
  for (ResinRecord& r : records) {
    const auto why = misfit(printer, r.resin);
    if (!why) {
      kept.push_back(std::move(r));
    } else if (*why == Misfit::wavelength) {
      ++left.wavelength;
      left.wavelengths_nm.insert(r.wavelength_nm);
    } else {
      ++(*why == Misfit::unit ? left.unit : left.tuned);
    }
  }
  const auto distance = [&](const ResinRecord& r) {
    if (r.wavelength_nm == 0) return 1e9;
    return printer.wavelength_nm > 0 ? std::abs(r.wavelength_nm - printer.wavelength_nm) : 0.0;
  };
  std::stable_sort(kept.begin(), kept.end(), [&](const ResinRecord& a, const ResinRecord& b) {
    return distance(a) < distance(b);
  });
  records = std::move(kept);
  return left;
}

void say_left_out(const LeftOut& left, const Printer& p, Console& console) {
  std::vector<std::string> why;
  if (left.wavelength > 0) {
    why.push_back(fmt::format("{} measured at {:g} nm, where the light of '{}' has {:g} nm",
                              left.wavelength, fmt::join(left.wavelengths_nm, ", "), p.name,
                              p.wavelength_nm));
  }
  if (left.unit > 0) {
    why.push_back(fmt::format(
        "{} whose doses count light in another unit than '{}', whose file has it in {}", left.unit,
        p.name, is_relative(p) ? "shares of the brightest level's" : "mW/cm²"));
  }
  if (left.tuned > 0) {
    why.push_back(fmt::format("{} tuned with another printer's light", left.tuned));
  }
  if (!why.empty()) console.say(fmt::format("left out: {}", fmt::join(why, "; ")));
}

/// What the files of a printer and of the resins that go with it do not say.
/// `asked`: somebody asked for a wavelength.
void say_unknown(const Printer& p, const std::vector<ResinRecord>& kept, bool asked,
                 Console& console) {
  const auto silent = std::count_if(kept.begin(), kept.end(),
                                    [](const ResinRecord& r) { return r.wavelength_nm == 0; });
  if (p.wavelength_nm == 0 && !asked) {
    console.say(fmt::format(
        "the file of '{}' does not say the wavelength of its light, so none is left out "
        "for it: what its maker says goes to [blue] wavelength_nm of your file, or to "
        "--wavelength-nm here",
        p.name));
  }
  if (p.wavelength_nm > 0 && silent > 0) {
    console.say(fmt::format("{} of them {} not say the wavelength of the light {} measured in",
                            silent, silent == 1 ? "does" : "do",
                            silent == 1 ? "it was" : "they were"));
  }
  if (!light_is_measured(p)) {
    console.say(fmt::format(
        "the light of '{}' is to be measured: its unit is not known, and none is left out "
        "for it (docs/print-files.md)",
        p.name));
  }
}

/// What to do where no resin was found.
void say_what_helps(const std::string& words, Console& console) {
  const SearchHelp help = search_help(words);
  if (help.alone.empty()) return;
  if (help.resins > 0) {
    console.say(fmt::format("{} {} these words; what else is asked for leaves {} out", help.resins,
                            help.resins == 1 ? "resin has" : "resins have",
                            help.resins == 1 ? "it" : "them"));
    return;
  }
  std::vector<std::string> each;
  for (const auto& [word, resins] : help.alone) {
    each.push_back(resins > 0 ? fmt::format("'{}' has {}", word, resins)
                              : fmt::format("'{}' has none", word));
  }
  console.say(fmt::format("no resin here {}{}",
                          each.size() == 1 ? fmt::format("has '{}'", help.alone.front().first)
                                           : "has all of these words: ",
                          each.size() == 1 ? "" : fmt::format("{}", fmt::join(each, ", "))));
  if (!help.near.empty()) {
    console.say(fmt::format("did you mean '{}'?", fmt::join(help.near, "', '")));
  }
  if (help.printers > 0) {
    console.say(fmt::format("{} {}: resinctl list --printers {}", help.printers,
                            help.printers == 1 ? "printer does" : "printers do",
                            fmt::join(words_in(words), " ")));
  }
  console.say(
      "Few makers publish what a correction needs of a resin, and another colour or kind does not "
      "stand in for yours. Films that your printer cures tell it, measured with calipers: slicecorr "
      "testpart films, then resinctl calibrate (docs/calipers.md); from a lab's heights resinctl fit "
      "does.");
}

int list(const ListArguments& a, const ExecutionContext&, Console& console) {
  const std::string words = fmt::format("{}", fmt::join(a.words, " "));
  if (a.printers) return list_printers(a, words, console);
  Query query;
  query.words = words;
  query.maker = a.maker;
  query.chemistry = a.chemistry;
  if (a.wavelength_nm > 0) query.wavelength_nm = a.wavelength_nm;
  set_heights(a.height_um, query);
  std::optional<Printer> printer;
  if (!a.printer.empty()) printer = load_display(find_definition(a.printer, "printer"));
  std::vector<Finding> problems;
  std::vector<ResinRecord> records = find_records(query, &problems);
  const bool any = !records.empty();
  LeftOut left;
  if (printer) left = keep_what_goes(*printer, records);
  std::vector<std::vector<std::string>> rows = {
      {"NAME", "MAKER", "NM", "H UM (E)", "H UM (10)", "GEL DOSE", "AIM", "FILE"}};
  auto list = ordered_json::array();
  for (const ResinRecord& r : records) {
    const ResinFigures f = figures_of(r.resin);
    rows.push_back({r.name, r.maker.empty() ? "-" : r.maker,
                    r.wavelength_nm > 0 ? fmt::format("{:g}", r.wavelength_nm) : "-",
                    fmt::format("{:.4g}", f.height_e_um), fmt::format("{:.4g}", f.height10_um),
                    gel_dose_text(r), aim_text(r), r.path});
    list.push_back(
        slicecorr::detail::own_json<nlohmann::ordered_json>(export_record(r, "json", 0, 0)));
  }
  put_list(a.json, list, rows, "resin", console);
  if (printer) {
    say_left_out(left, *printer, console);
    say_unknown(*printer, records, a.wavelength_nm > 0, console);
  }
  if (!any) say_what_helps(words + " " + a.maker, console);
  for (const Finding& p : problems) console.say(p.message);
  return cli::kDone;
}

}  // namespace

void add_list(cli::Program& program) {
  const auto l = std::make_shared<ListArguments>();
  CLI::App* sub = program.add(
      "list", "Resins (or printers) of the database, one a line, with gel dose and aim.",
      [l](const ExecutionContext& context, Console& console) {
        return list(*l, context, console);
      });
  sub->add_option(
         "WORDS", l->words,
         "All of them must occur in name, maker, product, aliases, tags, chemistry, colour, "
         "notes or wavelength; capitals, hyphens and blanks count for nothing")
      ->check(cli::value_is(cli::ValueKind::text));
  sub->add_option("--maker", l->maker, "Part of the maker's name")
      ->check(cli::value_is(cli::ValueKind::text));
  sub->add_option("--chemistry", l->chemistry, "Part of the chemistry")
      ->check(cli::value_is(cli::ValueKind::text));
  sub->add_option("--wavelength-nm", l->wavelength_nm, "Curing light within 10 nm of this")
      ->check(cli::number_above_zero());
  sub->add_option("--height-um", l->height_um,
                  "LOW:HIGH, absorbance height in base e; either may be left out")
      ->check(cli::value_is(cli::ValueKind::text));
  sub->add_option("--for", l->printer,
                  "Those that go with this printer: the same wavelength within 10 nm, and the same "
                  "unit of light; nearest first. It says how many others are left out, and why")
      ->check(cli::value_is(cli::ValueKind::printer));
  sub->add_flag("--printers", l->printers, "Printers instead");
  sub->add_option("--json", l->json, "Write JSON to this file, - for stdout");
}

}  // namespace slicecorr::resinctl
