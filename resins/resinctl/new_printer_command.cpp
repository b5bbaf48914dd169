// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// new-printer: a printer file by questions.
#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <iostream>
#include <memory>
#include <optional>
#include <sstream>
#include <string>
#include <vector>

#include "commands.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/image_size.hpp"
#include "slicecorr/letter_part.hpp"
#include "slicecorr/load_printer.hpp"
#include "slicecorr/process.hpp"
#include "slicecorr/resins/database.hpp"
#include "slicecorr/resins/exchange.hpp"

namespace slicecorr::resinctl {

namespace {

using namespace resins;
using cli::Console;

struct Arguments {
  std::string folder, picture;
  bool replace = false;
};

/// Questions on stderr, answers from stdin, a line each; a wrong answer is told and asked for again
/// where somebody sits at a terminal, and ends the program where a script does.
class Questions {
 public:
  explicit Questions(Console& console) : console_(console), person_(::isatty(STDIN_FILENO) != 0) {}

  std::string text(const std::string& question) {
    cli::write_stderr(question + ": ");
    std::string answer;
    if (!std::getline(std::cin, answer)) {
      throw InputError("stdin", "", "ends; expected an answer to '" + question + "'");
    }
    if (!person_) cli::write_stderr(answer + "\n");
    while (!answer.empty() && (answer.back() == ' ' || answer.back() == '\r')) answer.pop_back();
    answer.erase(0, std::min(answer.find_first_not_of(' '), answer.size()));
    return answer;
  }
  /// `otherwise`: what an empty answer means; without it there must be one.
  double number(const std::string& question, double least, double most,
                std::optional<double> otherwise = {}) {
    const std::string asked = otherwise ? fmt::format("{} [{:g}]", question, *otherwise) : question;
    for (;;) {
      const std::string answer = text(asked);
      if (answer.empty() && otherwise) return *otherwise;
      const auto value = cli::number_of(answer);
      if (value && *value >= least && *value <= most) return *value;
      refuse(fmt::format("'{}' is no number from {:g} to {:g}", answer, least, most));
    }
  }
  /// As `text`; a script may end before it.
  std::string last_text(const std::string& question) {
    if (!person_ && std::cin.peek() == std::char_traits<char>::eof()) return {};
    return text(question);
  }
  bool person() const { return person_; }
  void refuse(const std::string& why) {
    if (!person_) throw InputError("stdin", "", why);
    console_.say(why);
  }

 private:
  Console& console_;
  bool person_;
};

/// Who sits at a terminal learns that a name is taken before the other questions.
std::string name_asked(Questions& ask, const std::string& folder, bool replace) {
  const auto taken = [&](const std::string& name) {
    const std::filesystem::path in(folder);
    return std::filesystem::exists(in / (name + ".toml")) ||
           std::filesystem::exists(in / "printers" / (name + ".toml"));
  };
  for (;;) {
    std::string name =
        ask.text("Name of the printer, by which you will call it, such as my-printer");
    const bool plain = !name.empty() && std::all_of(name.begin(), name.end(), [](unsigned char c) {
      return (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') || c == '-' || c == '_';
    });
    if (plain && !(ask.person() && !replace && taken(name))) return name;
    if (plain) {
      ask.refuse(
          fmt::format("printer '{}' is there already; expected another name, or --replace", name));
      continue;
    }
    ask.refuse(fmt::format("'{}' is no name; expected small letters, digits, - and _", name));
  }
}

/// Grey levels with the light that was measured at them, black and the brightest among them.
std::string calibration_asked(Questions& ask, Console& console, int top) {
  console.say(fmt::format(
      "Now the light at the window: show an even grey, measure, and type the grey level and the "
      "intensity in mW/cm², as in '128 31.5'. Six levels are enough, 0 (black) and {} among them. "
      "An empty line ends.",
      top));
  for (;;) {
    std::vector<CalibrationPoint> points;
    for (;;) {
      const std::string line = ask.text(fmt::format("Reading {}", points.size() + 1));
      if (line.empty()) break;
      std::istringstream words(line);
      CalibrationPoint p;
      std::string rest;
      if (!(words >> p.level >> p.intensity_mw_cm2) || words >> rest || p.level < 0 ||
          p.level > top || p.intensity_mw_cm2 < 0) {
        ask.refuse(
            fmt::format("'{}' is no reading; expected a level of 0 to {} and mW/cm²", line, top));
        continue;
      }
      points.push_back(p);
    }
    std::sort(points.begin(), points.end(),
              [](const auto& a, const auto& b) { return a.level < b.level; });
    std::string wrong;
    if (points.size() < 2 || points.front().level != 0 || points.back().level != top) {
      wrong = fmt::format("the readings must hold level 0 and level {}", top);
    }
    for (std::size_t i = 1; i < points.size() && wrong.empty(); ++i) {
      if (points[i].level == points[i - 1].level) {
        wrong = fmt::format("level {:g} was read twice", points[i].level);
      } else if (points[i].intensity_mw_cm2 < points[i - 1].intensity_mw_cm2) {
        wrong = fmt::format("the light falls from level {:g} to {:g}", points[i - 1].level,
                            points[i].level);
      }
    }
    if (wrong.empty()) {
      std::string array = "[";
      for (const CalibrationPoint& p : points) {
        array += fmt::format("{}[{:g}, {:.10g}]", array.size() > 1 ? ", " : "", p.level,
                             p.intensity_mw_cm2);
      }
      return array + "]";
    }
    ask.refuse(wrong + "; please type them again");
  }
}

/// Four pictures side by side, from `first` on.
std::string letters_in_a_row(int first) {
  constexpr std::size_t kStep = 14, kHigh = 7;
  std::string text;
  std::string numbers;
  for (int number = first; number < first + 4; ++number) {
    numbers += fmt::format("{:<{}}", fmt::format("  {}", number), kStep);
  }
  text += numbers + "\n";
  for (std::size_t row = 0; row < kHigh; ++row) {
    std::string line;
    for (int number = first; number < first + 4; ++number) {
      const auto seen = letter_seen(kLetterTurns[static_cast<std::size_t>(number - 1)]);
      line += fmt::format("  {:<{}}", row < seen.size() ? seen[row] : "", kStep - 2);
    }
    while (line.ends_with(' ')) line.pop_back();
    if (!line.empty()) text += line + "\n";
  }
  return text;
}

/// The lines of [display] that say how the screen turns and mirrors; none where nobody knows yet.
std::string orientation_asked(Questions& ask, Console& console, const std::string& picture) {
  console.say(fmt::format(
      "How does an F stand on your screen? Show {} on it, upright in its file, lay thin white paper "
      "on the screen, stand in front of the printer and look down. Do not look into the light.\n\n{}\n"
      "{}\nThe lower edge of each picture is the front of the printer.",
      picture.empty() ? "a picture of an F" : picture, letters_in_a_row(1), letters_in_a_row(5)));
  for (;;) {
    const std::string answer =
        ask.last_text("Number of the picture that it looks like; empty when you do not know");
    if (answer.empty()) return {};
    const auto number = cli::number_of(answer);
    const int most = static_cast<int>(kLetterTurns.size());
    if (number && *number == std::floor(*number) && *number >= 1 && *number <= most) {
      std::string text;
      for (const std::string& line :
           orientation_lines(orientation_of_letter(static_cast<int>(*number)))) {
        text += line + "\n";
      }
      return text;
    }
    ask.refuse(fmt::format("'{}' is no picture; expected a number from 1 to {}", answer, most));
  }
}

int new_printer(const Arguments& a, Console& console) {
  Questions ask(console);
  console.say("A printer file by questions. An empty answer takes what stands in brackets.");
  Imported made;
  made.kind = "printer";
  const std::string folder = a.folder.empty() ? writable_folder() : a.folder;
  made.name = name_asked(ask, folder, a.replace);
  const auto whole = [&](const char* question, int least, int most,
                         std::optional<double> otherwise) {
    for (;;) {
      const double value = ask.number(question, least, most, otherwise);
      if (value == std::floor(value)) return static_cast<int>(value);
      ask.refuse(fmt::format("{:g} is no whole number", value));
    }
  };
  const int width = whole("Pixels of the display, across", 1, 65536, {});
  const int height = whole("Pixels of the display, down", 1, 65536, {});
  const double pixel_um = ask.number("Size of a pixel at the window, um", 0.1, 10000);
  const int bits = whole("Bits of a grey level", 1, 8, 8);
  const double nm = ask.number("Wavelength, nm; 0 when you do not know", 0, 2000, 405);
  const std::string calibration = calibration_asked(ask, console, (1 << bits) - 1);
  std::string light = "\n[blue]\n";
  if (nm > 0) light += fmt::format("wavelength_nm = {:g}\n", nm);
  light += fmt::format("calibration = {}  # grey level, mW/cm² at the window\n", calibration);
  const double speed =
      ask.number("Fastest speed of the stage, mm/h; 0 when you do not know", 0, 1e6, 0);
  const double travel = ask.number("Travel of the stage, mm; 0 when you do not know", 0, 1e5, 0);
  std::string stage;
  if (speed > 0 || travel > 0) {
    stage = "\n[stage]\n";
    if (speed > 0) stage += fmt::format("max_speed_mm_h = {:g}\n", speed);
    if (travel > 0) stage += fmt::format("travel_mm = {:g}\n", travel);
  }
  if (!a.picture.empty()) {
    if (!is_image_size(width, height)) {
      throw InputError(fmt::format("{} x {} pixels are more than a picture can have, {}", width,
                                   height, kMostPixels));
    }
    const auto png = encode_png(letter_image(width, height));
    cli::write_text_file(a.picture, {png.begin(), png.end()});
    console.say(fmt::format("{}: an F of {} x {} pixels", a.picture, width, height));
  }
  const std::string orientation = orientation_asked(ask, console, a.picture);
  made.text = fmt::format(
      "name = \"{}\"\n\n[display]\nwidth_px = {}\nheight_px = {}\npixel_um = {:g}\nbit_depth = "
      "{}\n{}{}{}",
      made.name, width, height, pixel_um, bits, orientation, light, stage);
  parse_printer(made.text, made.name + ".toml");
  const Replace replace = a.replace ? Replace::keep_history : Replace::refuse;
  must_be_free(folder, made, replace);
  const Saved saved = save_imported(made, folder, replace, "by new-printer");
  cli::print_result(saved.path + "\n");
  console.say(fmt::format(
      "printer {0}: saved. It is --printer {0} from now on. Where its light is uneven, measure some "
      "places and type: resinctl import readings.csv --printer {0} --replace (columns x_mm, y_mm, "
      "light)",
      made.name));
  if (orientation.empty()) {
    console.say(fmt::format(
        "Nothing says yet how its screen turns and mirrors: slicecorr testpart f --printer {} shows "
        "it, before a part comes out as its own mirror image.",
        made.name));
  }
  return cli::kDone;
}

}  // namespace

void add_new_printer(cli::Program& program) {
  const auto a = std::make_shared<Arguments>();
  CLI::App* sub = program.add(
      "new-printer",
      "Asks for what a printer file needs, a line each, and saves it in your own database.",
      [a](const ExecutionContext&, Console& console) { return new_printer(*a, console); });
  sub->add_option("-o,--folder", a->folder, "Save into this folder instead");
  sub->add_option(
      "--picture", a->picture,
      "Write a picture of an F here, as large as the display (.png), to be shown on it");
  sub->add_flag("--replace", a->replace,
                "Put it in the place of one of the same name, which goes to the history");
}

}  // namespace slicecorr::resinctl
