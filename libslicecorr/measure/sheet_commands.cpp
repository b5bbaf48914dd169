// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "measure/sheet_commands.hpp"

#include <fmt/format.h>

#include <map>

namespace slicecorr::detail {

std::vector<std::string> commands_on(const std::string& part, const std::string& form_file,
                                     const std::string& printer_file,
                                     const std::string& printer_name) {
  static const std::map<std::string, std::vector<std::string>> commands = {
      {"comb",
       {"slicecorr tune {0} --printed print.uvj --printer {1} --resin my-resin.toml -o tuned.toml"}},
      {"lift-comb",
       {"slicecorr tune {0} --printed print.uvj --printer {1} --resin my-resin.toml -o tuned.toml"}},
      {"dose-combs", {"slicecorr tune {0} --printer {1} --resin my-resin.toml -o tuned.toml"}},
      {"staircase",
       {"slicecorr tune {0} --printer {1} --resin my-resin.toml -o tuned.toml",
        "resinctl fit {0} --model kinetic -o new-resin.toml   # a resin that has no file yet"}},
      {"wedge",
       {"slicecorr tune {0} --printer {1} --resin my-resin.toml -o tuned.toml",
        "resinctl fit {0} --model jacobs -o new-resin.toml   # a resin that has no file yet"}},
      {"dead-zone",
       {"resinctl fit {0} --model deadzone-steady --resin my-resin.toml -o my-resin.toml"}},
      {"flat-field",
       {"resinctl import {0} --format flat-field --printer {1} --name my-printer --replace"}},
      {"f", {"slicecorr testpart f --printer {1} -o f-again.uvj"}},
      {"levels", {"resinctl import {0} --format calibration --printer {1} --name my-{2}"}},
      {"films", {"resinctl calibrate {0} --printer {1} -o my-{2}.toml --resin-out my-resin.toml"}},
      {"spread", {"resinctl fit-spread {0} --printer {1} --plot widths.svg"}}};
  std::vector<std::string> lines;
  const auto found = commands.find(part);
  if (found == commands.end()) return lines;
  for (const std::string& line : found->second) {
    lines.push_back(fmt::format(fmt::runtime(line), form_file, printer_file, printer_name));
  }
  return lines;
}

std::string readers_of(const std::string& part) {
  static const std::map<std::string, std::string> readers = {
      {"comb", "slicecorr tune"},
      {"lift-comb", "slicecorr tune"},
      {"dose-combs", "slicecorr tune without scans"},
      {"staircase", "slicecorr tune or resinctl fit --model kinetic"},
      {"wedge", "slicecorr tune or resinctl fit --model jacobs"},
      {"dead-zone", "resinctl fit --model deadzone-steady"},
      {"flat-field", "resinctl import --format flat-field"},
      {"levels", "resinctl import --format calibration"},
      {"films", "resinctl calibrate"},
      {"grid", "[display] distortion of a printer file"},
      {"spread", "resinctl fit-spread"}};
  const auto found = readers.find(part);
  return found == readers.end() ? "another version of slicecorr" : found->second;
}

}  // namespace slicecorr::detail
