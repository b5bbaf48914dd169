// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "submit/for_machine.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>

#include "slicecorr/farm/machines.hpp"
#include "slicecorr/mesh.hpp"
#include "submit/fields.hpp"
#include "submit/pass_over.hpp"
#include "support/text/ascii.hpp"

namespace slicecorr::farm::detail {

namespace {

std::string without_point(std::string ending) {
  if (ending.starts_with('.')) ending.erase(0, 1);
  return lower_case(ending);
}

void fit_to(JobRequest& r, const MachineSpec& machine) {
  if (is_tomographic(kind_of(r))) {
    const std::string why =
        "for: machines of machines.toml print layers, and the job is tomographic";
    if (pass_over(r, "for", why)) return;
    throw InputError(why);
  }
  std::string& printer = r.setup.printer;
  if (printer.empty()) printer = machine.printer;
  if (!machine.printer.empty() && printer != machine.printer) {
    throw InputError(fmt::format("for: the machine {} is a {}, the job is for a {}", machine.name,
                                 machine.printer, printer));
  }
  const std::vector<std::string> reads = formats_read_by(machine);
  // An archive stays one of its kind unless another is asked for.
  const bool mesh = !r.parts.empty() && is_mesh_name(r.parts[0]);
  const std::string of_part =
      mesh || r.parts.empty()
          ? std::string()
          : without_point(std::filesystem::path(r.parts[0]).extension().string());
  if (r.format.empty() && !reads.empty() &&
      std::find(reads.begin(), reads.end(), of_part) == reads.end()) {
    r.format = reads.front();
  }
  const std::string made = r.format.empty() ? of_part : without_point(r.format);
  if (!made.empty() && !reads.empty() &&
      std::find(reads.begin(), reads.end(), made) == reads.end()) {
    throw InputError(
        fmt::format("for: the job makes {}, the machine {} does not read it", made, machine.name));
  }
  const std::string label = "for " + machine.name;
  if (std::find(r.labels.begin(), r.labels.end(), label) == r.labels.end()) {
    r.labels.push_back(label);
  }
}

}  // namespace

void fit_to_machines(std::vector<JobRequest>& requests, const FarmFolder& folder,
                     std::vector<SubmitError>& errors) {
  for_each_sound(requests, errors, [&](JobRequest& r) {
    if (!r.machine.empty()) fit_to(r, machine_named(folder, r.machine));
  });
}

}  // namespace slicecorr::farm::detail
