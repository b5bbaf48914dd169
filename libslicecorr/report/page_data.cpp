// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <functional>
#include <nlohmann/json.hpp>

#include "parallel/silent.hpp"
#include "picture/embed.hpp"
#include "report/page_parts.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/inhibited.hpp"
#include "support/text/base64.hpp"

namespace slicecorr::detail {

namespace {

// Compressed bytes; a third more in base 64. Together the page stays at a few MB.
constexpr std::size_t kStateBudget = 1'000'000, kFieldBudget = 1'500'000, kColumnBudget = 1'000'000;
// Most tables of the kernel under UV light, before they are compressed.
constexpr std::size_t kKernelBudget = 4'000'000;

std::size_t cell(const ReducedVolume& v, int i, int j, int k) {
  return (static_cast<std::size_t>(k) * static_cast<std::size_t>(v.ny) +
          static_cast<std::size_t>(j)) *
             static_cast<std::size_t>(v.nx) +
         static_cast<std::size_t>(i);
}

/// Every `every`-th cell along each side; as differences from one layer of cells to the next, which
/// compress better.
Bytes sampled(const ReducedVolume& v, const Bytes& field, int every) {
  Bytes out;
  const auto count = [&](int n) { return static_cast<std::size_t>((n + every - 1) / every); };
  const std::size_t layer = count(v.nx) * count(v.ny);
  out.reserve(layer * count(v.nz));
  for (int k = 0; k < v.nz; k += every) {
    for (int j = 0; j < v.ny; j += every) {
      for (int i = 0; i < v.nx; i += every) out.push_back(field[cell(v, i, j, k)]);
    }
  }
  for (std::size_t at = out.size(); at-- > layer;) {
    out[at] = static_cast<std::uint8_t>(out[at] - out[at - layer]);
  }
  return out;
}

/// The greatest error in each block of cells.
Bytes greatest(const ReducedVolume& v, const Bytes& error, int every) {
  const auto count = [&](int n) { return static_cast<std::size_t>((n + every - 1) / every); };
  Bytes out(count(v.nx) * count(v.ny) * count(v.nz), 0);
  for (int k = 0; k < v.nz; ++k) {
    for (int j = 0; j < v.ny; ++j) {
      for (int i = 0; i < v.nx; ++i) {
        const std::uint8_t e = error[cell(v, i, j, k)];
        std::uint8_t& to = out[(static_cast<std::size_t>(k / every) * count(v.ny) +
                                static_cast<std::size_t>(j / every)) *
                                   count(v.nx) +
                               static_cast<std::size_t>(i / every)];
        if (e && (!to || std::abs(e - 128) > std::abs(to - 128))) to = e;
      }
    }
  }
  return out;
}

void put_number(Bytes& out, std::uint32_t value) {
  for (; value >= 128; value >>= 7) out.push_back(static_cast<std::uint8_t>(value | 128));
  out.push_back(static_cast<std::uint8_t>(value));
}

/// Per column x, y, then for coverage and levels the number of runs, and value and length of each;
/// where light spreads then the same of the light before and after, with numbers for values.
Bytes column_codes(const ReducedVolume& v, int every) {
  Bytes out;
  for (int j = 0; j < v.ny; j += every) {
    for (int i = 0; i < v.nx; i += every) {
      const auto& column = v.columns[static_cast<std::size_t>(j) * static_cast<std::size_t>(v.nx) +
                                     static_cast<std::size_t>(i)];
      put_number(out, static_cast<std::uint32_t>(column.x));
      put_number(out, static_cast<std::uint32_t>(column.y));
      for (const auto* runs : {&column.coverage, &column.levels}) {
        put_number(out, static_cast<std::uint32_t>(runs->size()));
        for (const ReducedVolume::Run run : *runs) {
          out.push_back(static_cast<std::uint8_t>(run.value));
          put_number(out, run.slices);
        }
      }
      if (v.greatest_light == 0) continue;
      for (const auto* runs : {&column.light_before, &column.light_after}) {
        put_number(out, static_cast<std::uint32_t>(runs->size()));
        for (const ReducedVolume::LightRun run : *runs) {
          put_number(out, run.code);
          put_number(out, run.slices);
        }
      }
    }
  }
  return out;
}

/// What each column's phi is multiplied by, where light is uneven: the different factors, and which
/// of them a column has.
nlohmann::ordered_json gains_json(const ReducedVolume& v, int every, double m) {
  std::vector<double> factors;
  for (const auto& column : v.columns) factors.push_back(column.light);
  std::sort(factors.begin(), factors.end());
  factors.erase(std::unique(factors.begin(), factors.end()), factors.end());
  Bytes of;
  for (int j = 0; j < v.ny; j += every) {
    for (int i = 0; i < v.nx; i += every) {
      const double light = v.columns[static_cast<std::size_t>(j) * static_cast<std::size_t>(v.nx) +
                                     static_cast<std::size_t>(i)]
                               .light;
      of.push_back(static_cast<std::uint8_t>(
          std::lower_bound(factors.begin(), factors.end(), light) - factors.begin()));
    }
  }
  std::vector<double> gains;
  gains.reserve(factors.size());
  for (const double f : factors) gains.push_back(std::pow(f, m));
  return {{"factors", factors}, {"gains", gains}, {"of", base64(deflated(of))}};
}

/// The kernel's tables as floats, by setting, place, distance and level; nothing when they are too
/// large.
nlohmann::ordered_json kernel_json(const InhibitedKernel& kernel, int layers) {
  const std::size_t table =
      static_cast<std::size_t>(kernel.near()) * static_cast<std::size_t>(kernel.levels());
  const std::size_t tables = 3 * static_cast<std::size_t>(kernel.settings());
  if (table * tables * sizeof(float) > kKernelBudget) return {};
  Bytes bytes(table * tables * sizeof(float));
  std::uint8_t* out = bytes.data();
  for (int setting = 0; setting < kernel.settings(); ++setting) {
    for (int place = 0; place < 3; ++place) {
      const double* values =
          kernel.table(setting, static_cast<InhibitedKernel::LayerPosition>(place));
      for (std::size_t i = 0; i < table; ++i, out += sizeof(float)) {
        const auto value = static_cast<float>(values[i]);
        std::memcpy(out, &value, sizeof value);
      }
    }
  }
  std::vector<int> settings;
  settings.reserve(static_cast<std::size_t>(layers));
  for (int n = 0; n < layers; ++n) settings.push_back(kernel.setting_of_slice(n));
  return {{"near", kernel.near()},
          {"levels", kernel.levels()},
          {"a", kernel.a()},
          {"setting", settings},
          {"values", base64(deflated(bytes))}};
}

}  // namespace

std::string page_data(const ReducedVolume& volume, const CureModel& model, const Grid& grid,
                      const std::array<int, 3>& start, const ExecutionContext& context) {
  // Makes `count` packed fields; true when they fit together.
  const auto fit = [&](std::size_t most, std::size_t count, Bytes* packed,
                       const std::function<Bytes(std::size_t)>& make) {
    std::atomic<bool> all{true};
    parallel_for(silent(context), "", count, [&](std::size_t i) {
      if (all && !deflate_within(most, make(i), packed[i])) all = false;
    });
    if (!all) return false;
    std::size_t sum = 0;
    for (std::size_t i = 0; i < count; ++i) sum += packed[i].size();
    return sum <= most;
  };
  Bytes states[2];
  ReducedVolume fewer;  // cells, where all do not fit
  const ReducedVolume* fitting = &volume;
  const auto states_fit = [&] {
    const std::size_t most = fitting->cells() < 1000 ? SIZE_MAX : kStateBudget;
    return fit(most, 2, states,
               [&](std::size_t i) { return i ? fitting->after.state : fitting->before.state; });
  };
  while (!states_fit()) {
    fewer = coarser(*fitting);
    fitting = &fewer;
  }
  const ReducedVolume& v = *fitting;
  nlohmann::ordered_json j;
  j["box"] = {v.box.x0, v.box.y0, v.box.x1, v.box.y1};
  j["image"] = {grid.width_px, grid.height_px};
  j["layers"] = v.layers;
  j["voxelUm"] = {grid.pixel_x_um, grid.pixel_y_um, grid.layer_um};
  if (!model.heights.alike()) {
    // Cells are drawn alike, as high as layers are on average; words say places.
    std::vector<double> nodes_um;
    for (int n = 0; n <= v.layers; ++n) nodes_um.push_back(model.depth(n) * model.layer_um);
    j["voxelUm"][2] = nodes_um.back() / std::max(1, v.layers);
    j["nodesUm"] = nodes_um;
  }
  j["step"] = {v.step_x, v.step_y, v.step_z};
  j["cells"] = {v.nx, v.ny, v.nz};
  j["start"] = start;
  j["a"] = model.a;
  j["phi"] = model.level_phi;
  // Absent where the bath has no end.
  if (model.bath_slices > 0) j["bath"] = {model.bath_slices, model.beyond};
  // Absent where the platform sends no light back.
  if (model.mirrored_slices > 0) j["mirror"] = {model.reflectance, model.eta / model.m, model.m};
  // Absent where exposure is continuous and without UV light.
  if (model.mode == ExposureMode::layerwise) j["layerwise"] = true;
  if (!model.exposure_ratio.empty()) j["ratio"] = model.exposure_ratio;
  const bool uneven = std::any_of(v.columns.begin(), v.columns.end(),
                                  [](const auto& column) { return column.light != 1; });
  // Uneven light has kernels of its own in each place, light that spreads in each column.
  if (model.inhibited()) {
    j["kernel"] = uneven || v.under_uv || !model.inhibited()->alike()
                      ? nlohmann::ordered_json()
                      : kernel_json(*model.inhibited(), v.layers);
  }
  // Doses that are no sums over slices are not for the page's own arithmetic.
  const bool exchanged = model.lifts && model.lifts->exchange.value_or(0) > 0;
  if (!model.adds_up() || exchanged || !model.heights.alike()) j["kernel"] = nullptr;
  j["state"] = {base64(states[0]), base64(states[1])};

  Bytes fields[6];
  int every = 1;
  for (;; ++every) {
    const auto field = [&](std::size_t i) {
      const ReducedPrint& print = i % 2 ? v.after : v.before;
      return i < 2   ? sampled(v, print.dose, every)
             : i < 4 ? sampled(v, print.grey, every)
                     : greatest(v, print.error, every);
    };
    if (fit(every >= 8 ? SIZE_MAX : kFieldBudget, 6, fields, field)) break;
  }
  j["fieldEvery"] = every;
  j["dose"] = {base64(fields[0]), base64(fields[1])};
  j["grey"] = {base64(fields[2]), base64(fields[3])};
  j["error"] = {base64(fields[4]), base64(fields[5])};

  std::size_t runs = 0;
  for (const auto& column : v.columns) {
    runs += column.coverage.size() + column.levels.size() + column.light_before.size() +
            column.light_after.size();
  }
  Bytes columns;
  for (every = 1;; ++every) {
    // Codes hardly shrink more than twelvefold: don't make what can't fit.
    const std::size_t least = runs * 2 / static_cast<std::size_t>(every * every) / 12;
    if (least > kColumnBudget) continue;
    const std::size_t most = every >= std::max(v.nx, v.ny) ? SIZE_MAX : kColumnBudget;
    if (deflate_within(most, column_codes(v, every), columns)) break;
  }
  j["columnEvery"] = every;
  j["columns"] = base64(columns);
  if (v.greatest_light > 0) {
    j["spread"] = {v.least_light, v.greatest_light, ReducedVolume::kLightCodes - 1};
  }
  if (uneven) j["light"] = gains_json(v, every, model.m);
  return j.dump();
}

}  // namespace slicecorr::detail
