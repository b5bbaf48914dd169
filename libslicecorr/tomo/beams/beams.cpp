// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/tomo/beams.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>

#include "parallel/silent.hpp"
#include "slice/placing.hpp"
#include "slicecorr/chemistry.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/supports.hpp"
#include "slicecorr/turbidity.hpp"
#include "support/numbers/bracket.hpp"
#include "tomo/beams/beam_grid.hpp"
#include "tomo/beams/beam_solver.hpp"
#include "tomo/print/voxels.hpp"

namespace slicecorr::tomo {
namespace {

constexpr double kInfinite = std::numeric_limits<double>::infinity();
/// Cells that are told to stand against a part, at most.
constexpr std::size_t kMostTold = 200;
/// Of a cell, by which a part may be wider than the cells that it is cut to.
constexpr double kTouch = 1e-3;

int cells_along(const Box<std::uint8_t>& part, int axis) {
  return axis == 0 ? part.nx : axis == 1 ? part.ny : part.nz;
}

std::vector<int> all_of(int cells) {
  std::vector<int> index(static_cast<std::size_t>(cells));
  std::iota(index.begin(), index.end(), 0);
  return index;
}

/// The image's pixel on whose ray a cell is.
std::size_t pixel_of(const BeamImage& image, int x, int y, int z) {
  const int row = image.beam.axis == 2 ? y : z, column = image.beam.axis == 0 ? y : x;
  return static_cast<std::size_t>(row) * static_cast<std::size_t>(image.columns) +
         static_cast<std::size_t>(column);
}

BeamImage dark_image(const Box<std::uint8_t>& part, const Beam& beam) {
  BeamImage image{beam, beam.axis == 2 ? part.ny : part.nz, beam.axis == 0 ? part.ny : part.nx, {}};
  image.share.assign(static_cast<std::size_t>(image.rows) * static_cast<std::size_t>(image.columns),
                     0.0F);
  return image;
}

template <class Use>
void each_cell(const Box<std::uint8_t>& part, const Use& use) {
  std::size_t at = 0;
  for (int z = 0; z < part.nz; ++z) {
    for (int y = 0; y < part.ny; ++y) {
      for (int x = 0; x < part.nx; ++x, ++at) use(x, y, z, part.values[at]);
    }
  }
}

void check(const Box<std::uint8_t>& part, const BeamSetup& s) {
  if (s.beams.empty()) throw InputError("there are no beams; expected 2, 3, 4 or 6");
  if (!(s.cell_mm > 0) || !std::isfinite(s.cell_mm)) {
    throw InputError("expected cells of more than 0 mm");
  }
  if (!(s.alpha_per_mm >= 0) || !std::isfinite(s.alpha_per_mm)) {
    throw InputError("expected an absorption of 0 or more");
  }
  if (s.steps < 0) throw InputError("expected 0 or more steps");
  for (int axis = 0; axis < 3; ++axis) {
    const double vat = s.vat_mm[static_cast<std::size_t>(axis)];
    if (vat == 0) continue;
    if (!(vat >= cells_along(part, axis) * s.cell_mm * (1 - 1e-9)) || !std::isfinite(vat)) {
      throw InputError(fmt::format(
          "the part's cells take {:g} mm along {}, the vat is {:g} mm inside; expected a part that "
          "fits into the vat",
          cells_along(part, axis) * s.cell_mm, "xyz"[axis], vat));
    }
  }
  if (std::none_of(part.values.begin(), part.values.end(), [](auto v) { return v == 255; })) {
    throw InputError("the volume has no cell that is wholly part; expected 255 where it is");
  }
  if (std::none_of(part.values.begin(), part.values.end(), [](auto v) { return v == 0; })) {
    throw InputError(
        "the part fills all of the vat, so nothing can gel that should not; expected some empty "
        "cells around it");
  }
}

/// Lit where the part is on the ray; `alone`: where nothing else is.
std::vector<BeamImage> plain_images(const Box<std::uint8_t>& part, const BeamSetup& setup,
                                    bool alone) {
  std::vector<BeamImage> images;
  for (const Beam& beam : setup.beams) {
    // Two beams against each other have one image.
    const auto same = std::find_if(images.begin(), images.end(),
                                   [&](const BeamImage& i) { return i.beam.axis == beam.axis; });
    if (same != images.end()) {
      BeamImage image = *same;
      image.beam = beam;
      images.push_back(std::move(image));
      continue;
    }
    BeamImage image = dark_image(part, beam);
    each_cell(part, [&](int x, int y, int z, std::uint8_t v) {
      if (v == 255) image.share[pixel_of(image, x, y, z)] = 1;
    });
    if (alone) {
      each_cell(part, [&](int x, int y, int z, std::uint8_t v) {
        if (v != 255) image.share[pixel_of(image, x, y, z)] = 0;
      });
    }
    images.push_back(std::move(image));
  }
  // From wall to wall: what is before the first and behind the last cell is no part.
  if (alone) {
    for (BeamImage& image : images) {
      if (setup.before_mm(image.beam.axis, cells_along(part, image.beam.axis)) <
          0.5 * setup.cell_mm) {
        continue;
      }
      std::fill(image.share.begin(), image.share.end(), 0.0F);
    }
  }
  return images;
}

void find_hull(const Box<std::uint8_t>& part, const std::vector<BeamImage>& silhouettes,
               BeamPrint& print) {
  std::size_t part_cells = 0;
  const bool tell = print.in_the_way.empty();
  std::vector<std::array<int, 3>> beyond;
  each_cell(part, [&](int x, int y, int z, std::uint8_t v) {
    part_cells += v == 255 ? 1 : 0;
    if (v != 0) return;
    for (const BeamImage& image : silhouettes) {
      if (!(image.share[pixel_of(image, x, y, z)] > 0)) return;
    }
    ++print.hull_cells;
    if (tell && beyond.size() < kMostTold) beyond.push_back({x, y, z});
  });
  print.hull_jaccard =
      static_cast<double>(part_cells) / static_cast<double>(part_cells + print.hull_cells);
}

/// Cells outside that get as much as the part, the brightest first.
std::vector<std::array<int, 3>> bright_outside(const Box<std::uint8_t>& part,
                                               const Box<float>& light, double least) {
  std::vector<std::pair<float, std::array<int, 3>>> found;
  std::size_t at = 0;
  each_cell(part, [&](int x, int y, int z, std::uint8_t v) {
    const float here = light.values[at++];
    if (v == 0 && here > 0 && here >= least) found.push_back({here, {x, y, z}});
  });
  const std::size_t told = std::min(found.size(), kMostTold);
  std::partial_sort(found.begin(), found.begin() + static_cast<std::ptrdiff_t>(told), found.end(),
                    [](const auto& a, const auto& b) {
                      return a.first > b.first || (a.first == b.first && a.second < b.second);
                    });
  std::vector<std::array<int, 3>> cells;
  for (std::size_t i = 0; i < told; ++i) cells.push_back(found[i].second);
  return cells;
}

}  // namespace

detail::DecidingCells::DecidingCells(const Box<std::uint8_t>& part, const BeamSetup& setup) {
  if (setup.goes_sideways()) {
    for (int axis = 0; axis < 3; ++axis) {
      index[static_cast<std::size_t>(axis)] = all_of(cells_along(part, axis));
    }
    return;
  }
  int low[3] = {part.nx, part.ny, part.nz}, high[3] = {-1, -1, -1};
  each_cell(part, [&](int x, int y, int z, std::uint8_t v) {
    if (v != 255) return;
    const int at[3] = {x, y, z};
    for (int i = 0; i < 3; ++i) {
      low[i] = std::min(low[i], at[i]);
      high[i] = std::max(high[i], at[i]);
    }
  });
  for (int i = 0; i < 3; ++i) {
    std::vector<int>& of = index[static_cast<std::size_t>(i)];
    const int last = cells_along(part, i) - 1;
    if (low[i] > 0) of.push_back(0);
    for (int k = low[i]; k <= high[i]; ++k) of.push_back(k);
    if (high[i] < last) of.push_back(last);
  }
}

detail::CellBlur detail::cell_blur(const BeamSetup& setup, double path_mm) {
  CellBlur blur;
  std::vector<SpreadGaussian> gaussians = setup.spread;
  if (gaussians.empty()) gaussians.push_back({0, 1});
  double weights = 0;
  for (const SpreadGaussian& g : gaussians) weights += g.weight;
  for (const SpreadGaussian& g : gaussians) {
    const double variance_mm2 =
        g.sigma_um * g.sigma_um * 1e-6 + setup.scatter_um2_per_um * 1e-3 * path_mm;
    const double s = std::sqrt(variance_mm2) / setup.cell_mm;
    CellBlur::Gaussian& to = blur.sum.emplace_back();
    to.weight = g.weight / weights;
    if (s < 1e-6) {
      to.shares = {1};
      continue;
    }
    // The integral of a normal distribution's integral.
    const auto twice = [](double x) {
      return x * 0.5 * std::erfc(-x / std::numbers::sqrt2) +
             std::exp(-0.5 * x * x) / std::sqrt(2 * std::numbers::pi);
    };
    const int reach = static_cast<int>(std::ceil(kSpreadReachSigmas * s + 1));
    for (int k = 0; k <= reach; ++k) {
      to.shares.push_back(
          std::max(0.0, s * (twice((k + 1) / s) - 2 * twice(k / s) + twice((k - 1) / s))));
    }
  }
  return blur;
}

std::vector<detail::CellBlur> detail::blurs_along(const BeamSetup& setup, const Beam& beam,
                                                  int cells, const std::vector<int>& index) {
  std::vector<CellBlur> all;
  const double before = setup.before_mm(beam.axis, cells);
  for (const int i : index) {
    const int nth = beam.from_end ? cells - 1 - i : i;
    all.push_back(cell_blur(setup, before + (nth + 0.5) * setup.cell_mm));
  }
  return all;
}

void take_spread(BeamSetup& setup, const Printer& printer, const Resin& resin) {
  if (printer.spread.picture) {
    throw InputError(fmt::format(
        "printer '{}': spread in [blue] is a picture, which is not counted where light comes from "
        "the sides; expected Gaussians, [[sigma_um, weight], ...]",
        printer.name));
  }
  setup.spread = printer.spread.none() ? std::vector<SpreadGaussian>{} : printer.spread.gaussians;
  setup.scatter_um2_per_um = resin.scatter_um2_per_um;
}

namespace {

/// The image as it is at a place of the beam.
std::vector<float> blurred(const BeamImage& image, const detail::CellBlur& blur) {
  std::vector<double> sum(image.share.size());
  const auto at = [&](int r, int c) {
    return static_cast<std::size_t>(r) * static_cast<std::size_t>(image.columns) +
           static_cast<std::size_t>(c);
  };
  for (const detail::CellBlur::Gaussian& g : blur.sum) {
    const int reach = static_cast<int>(g.shares.size()) - 1;
    std::vector<double> along(image.share.size());
    for (int r = 0; r < image.rows; ++r) {
      for (int c = 0; c < image.columns; ++c) {
        for (int k = std::max(0, c - reach); k <= std::min(image.columns - 1, c + reach); ++k) {
          along[at(r, c)] +=
              g.shares[static_cast<std::size_t>(std::abs(k - c))] * image.share[at(r, k)];
        }
      }
    }
    for (int r = 0; r < image.rows; ++r) {
      for (int k = std::max(0, r - reach); k <= std::min(image.rows - 1, r + reach); ++k) {
        const double share = g.weight * g.shares[static_cast<std::size_t>(std::abs(k - r))];
        for (int c = 0; c < image.columns; ++c) sum[at(r, c)] += share * along[at(k, c)];
      }
    }
  }
  return {sum.begin(), sum.end()};
}

/// Light that goes sideways: place by place along each beam.
void add_blurred_light(Box<float>& light, const BeamImage& image, const BeamSetup& setup,
                       const ExecutionContext& context) {
  const int sizes[3] = {light.nx, light.ny, light.nz}, cells = sizes[image.beam.axis];
  const std::vector<double> left = detail::light_left(setup, image.beam, cells, all_of(cells));
  const std::vector<detail::CellBlur> blurs =
      detail::blurs_along(setup, image.beam, cells, all_of(cells));
  const int axis = image.beam.axis, rows = axis == 2 ? light.ny : light.nz,
            columns = axis == 0 ? light.ny : light.nx;
  parallel_for(slicecorr::detail::silent(context), "", blurs.size(), [&](std::size_t i) {
    const std::vector<float> here = blurred(image, blurs[i]);
    const int k = static_cast<int>(i);
    for (int r = 0; r < rows; ++r) {
      for (int c = 0; c < columns; ++c) {
        const std::size_t cell = axis == 0   ? light.at(r, c, k)
                                 : axis == 1 ? light.at(r, k, c)
                                             : light.at(k, r, c);
        const std::size_t pixel = static_cast<std::size_t>(r) * static_cast<std::size_t>(columns) +
                                  static_cast<std::size_t>(c);
        light.values[cell] += static_cast<float>(here[pixel] * left[i]);
      }
    }
  });
}

}  // namespace

const char* name_of(BeamImages images) {
  switch (images) {
    case BeamImages::silhouette:
      return "silhouette";
    case BeamImages::end_on:
      return "end-on";
    case BeamImages::grey:
      break;
  }
  return "grey";
}

BeamImages beam_images_named(std::string_view name) {
  for (const BeamImages images : {BeamImages::silhouette, BeamImages::end_on, BeamImages::grey}) {
    if (name == name_of(images)) return images;
  }
  throw InputError(fmt::format("no images '{}'; expected silhouette, end-on or grey", name));
}

std::vector<Beam> beams_of(int count) {
  switch (count) {
    case 2:
      return {{0, false}, {1, false}};
    case 3:
      return {{0, false}, {1, false}, {2, false}};
    case 4:
      return {{0, false}, {1, false}, {0, true}, {1, true}};
    case 6:
      return {{0, false}, {1, false}, {2, false}, {0, true}, {1, true}, {2, true}};
    default:
      throw InputError(fmt::format("{} beams; expected 2, 3, 4 or 6", count));
  }
}

std::string side_of(const Beam& beam) {
  return std::string(beam.from_end ? "+" : "-") + "xyz"[beam.axis];
}

Box<float> light_of(int nz, int ny, int nx, const std::vector<BeamImage>& images,
                    const BeamSetup& setup, const ExecutionContext& context) {
  Box<float> light{nz, ny, nx, {}};
  light.values.resize(static_cast<std::size_t>(nz) * static_cast<std::size_t>(ny) *
                      static_cast<std::size_t>(nx));
  if (setup.goes_sideways()) {
    for (const BeamImage& image : images) add_blurred_light(light, image, setup, context);
    return light;
  }
  const int sizes[3] = {nx, ny, nz};
  std::vector<std::vector<double>> left;
  for (const BeamImage& image : images) {
    const int cells = sizes[image.beam.axis];
    left.push_back(detail::light_left(setup, image.beam, cells, all_of(cells)));
  }
  parallel_for(slicecorr::detail::silent(context), "", static_cast<std::size_t>(nz),
               [&](std::size_t slice) {
                 const int z = static_cast<int>(slice);
                 for (int y = 0; y < ny; ++y) {
                   for (int x = 0; x < nx; ++x) {
                     double sum = 0;
                     for (std::size_t k = 0; k < images.size(); ++k) {
                       const BeamImage& image = images[k];
                       const int at[3] = {x, y, z};
                       sum += image.share[pixel_of(image, x, y, z)] *
                              left[k][static_cast<std::size_t>(at[image.beam.axis])];
                     }
                     light.values[light.at(z, y, x)] = static_cast<float>(sum);
                   }
                 }
               });
  return light;
}

BeamFigures figures_of(const Box<std::uint8_t>& part, const Box<float>& light) {
  BeamFigures f;
  float least = std::numeric_limits<float>::infinity(), most = 0;
  std::vector<float> inside, outside;
  for (std::size_t i = 0; i < part.values.size(); ++i) {
    const float here = light.values[i];
    if (part.values[i] == 255) {
      inside.push_back(here);
      least = std::min(least, here);
      f.unlit_cells += here > 0 ? 0 : 1;
    } else if (part.values[i] == 0) {
      ++f.outside_cells;
      most = std::max(most, here);
    }
  }
  f.part_cells = inside.size();
  f.least_inside = least;
  f.most_outside = most;
  f.contrast = !(least > 0) ? 0 : most > 0 ? static_cast<double>(least) / most : kInfinite;
  // Below the least light of the part a threshold only takes in more of what is outside.
  for (std::size_t i = 0; i < part.values.size(); ++i) {
    const float here = light.values[i];
    if (part.values[i] == 0 && here > 0 && here >= least) outside.push_back(here);
  }
  f.wrong_cells = outside.size();
  f.ver = static_cast<double>(f.wrong_cells) / static_cast<double>(f.part_cells + f.outside_cells);
  std::sort(inside.begin(), inside.end(), std::greater<>());
  std::sort(outside.begin(), outside.end(), std::greater<>());
  for (std::size_t i = 0, o = 0; i < inside.size();) {
    const float t = inside[i];
    if (!(t > 0)) break;
    while (i < inside.size() && inside[i] >= t) ++i;
    while (o < outside.size() && outside[o] >= t) ++o;
    const double jaccard = static_cast<double>(i) / static_cast<double>(f.part_cells + o);
    if (jaccard < f.best_jaccard) continue;
    f.best_jaccard = jaccard;
    f.threshold = t;
  }
  f.jaccard = least > 0 ? static_cast<double>(f.part_cells) /
                              static_cast<double>(f.part_cells + f.wrong_cells)
                        : f.best_jaccard;
  return f;
}

Box<std::uint8_t> cut_cells(TriangleMesh mesh, double cell_mm, const ExecutionContext& context) {
  if (mesh.triangles.empty()) throw InputError("there is no triangle to slice");
  const slicecorr::detail::PartBox box = slicecorr::detail::box_of(mesh, context);
  int cells[2];
  for (std::size_t axis = 0; axis < 2; ++axis) {
    const double wide = std::ceil((box.high[axis] - box.low[axis]) / cell_mm - kTouch);
    if (!(wide <= kMostAlongAxis)) {
      throw InputError(
          fmt::format("the part is more than {} cells of {:g} mm wide; expected larger "
                      "cells",
                      kMostAlongAxis, cell_mm));
    }
    cells[axis] = std::max(1, static_cast<int>(wide));
  }
  return detail::coverage_of(std::move(mesh), "beams", cells[0], cells[1], cell_mm, context);
}

Box<std::uint8_t> filled_vat(const Box<std::uint8_t>& volume, const BeamSetup& setup) {
  int more[3] = {0, 0, 0};
  for (int axis = 0; axis < 3; ++axis) {
    const double before = setup.before_mm(axis, cells_along(volume, axis));
    if (before < -1e-9 * setup.cell_mm * cells_along(volume, axis)) {
      throw InputError(fmt::format(
          "the part's cells take {:g} mm along {}, the vat is {:g} mm inside; expected a part that "
          "fits into the vat",
          cells_along(volume, axis) * setup.cell_mm, "xyz"[axis],
          setup.vat_mm[static_cast<std::size_t>(axis)]));
    }
    const double cells = before / setup.cell_mm;
    if (cells > kMostAlongAxis) {
      throw InputError(
          fmt::format("the vat has more than {} cells of {:g} mm along {}; expected larger cells",
                      kMostAlongAxis, setup.cell_mm, "xyz"[axis]));
    }
    more[axis] = static_cast<int>(std::floor(cells + 1e-6));
  }
  Box<std::uint8_t> vat{
      volume.nz + 2 * more[2], volume.ny + 2 * more[1], volume.nx + 2 * more[0], {}};
  const double cells = static_cast<double>(vat.nz) * vat.ny * vat.nx;
  if (cells > static_cast<double>(kMostInBox)) {
    throw InputError(
        fmt::format("the vat has {:.3g} cells of {:g} mm; expected {:.3g} at most, so larger cells",
                    cells, setup.cell_mm, static_cast<double>(kMostInBox)));
  }
  vat.values.assign(static_cast<std::size_t>(cells), 0);
  for (int z = 0; z < volume.nz; ++z) {
    for (int y = 0; y < volume.ny; ++y) {
      std::copy_n(&volume.values[volume.at(z, y, 0)], volume.nx,
                  &vat.values[vat.at(z + more[2], y + more[1], more[0])]);
    }
  }
  return vat;
}

double bytes_of_beams(const Box<std::uint8_t>& part, const BeamSetup& setup) {
  // The part, its light, and that of what is shown.
  double bytes = 9.0 * static_cast<double>(part.values.size());
  if (setup.images == BeamImages::grey) bytes += detail::bytes_of_grey(part, setup);
  return bytes;
}

BeamPrint find_beams(const Box<std::uint8_t>& part, const BeamSetup& setup,
                     const ExecutionContext& context) {
  check(part, setup);
  BeamPrint print;
  std::vector<BeamImage> silhouettes = plain_images(part, setup, false);
  find_hull(part, silhouettes, print);
  const auto judge = [&](std::vector<BeamImage> images) {
    print.light = light_of(part.nz, part.ny, part.nx, images, setup, context);
    print.figures = figures_of(part, print.light);
    print.images = std::move(images);
  };
  if (setup.images == BeamImages::silhouette) {
    judge(std::move(silhouettes));
  } else {
    std::vector<BeamImage> end_on = plain_images(part, setup, true);
    judge(std::move(end_on));
    // Nothing is better than a dark outside.
    const bool perfect = !(print.figures.most_outside > 0) && print.figures.unlit_cells == 0;
    if (setup.images == BeamImages::grey && !perfect) {
      detail::GreyImages grey = detail::grey_images(part, setup, std::move(silhouettes), context);
      judge(std::move(grey.images));
      print.contrast_bound = grey.contrast_bound;
      print.in_the_way = std::move(grey.in_the_way);
    }
  }
  if (print.in_the_way.empty()) {
    print.in_the_way = bright_outside(part, print.light, print.figures.least_inside);
  }
  if (print.in_the_way.size() > kMostTold) print.in_the_way.resize(kMostTold);
  return print;
}

double most_absorption_per_mm(const Box<std::uint8_t>& part, const std::vector<BeamImage>& images,
                              const BeamSetup& setup, const ExecutionContext& context) {
  check(part, setup);
  BeamSetup s = setup;
  const auto separates = [&](double alpha) {
    s.alpha_per_mm = alpha;
    const Box<float> light = light_of(part.nz, part.ny, part.nx, images, s, context);
    float least = std::numeric_limits<float>::infinity(), most = 0;
    for (std::size_t i = 0; i < part.values.size(); ++i) {
      if (part.values[i] == 255) least = std::min(least, light.values[i]);
      if (part.values[i] == 0) most = std::max(most, light.values[i]);
    }
    return least > most;
  };
  if (!separates(0)) return 0;
  double low = 0, high = setup.alpha_per_mm;
  if (!(high > 0) || separates(high)) return high;
  return halved({low, high}, 12,
                [&](double alpha) {
                  context.check_cancelled();
                  return separates(alpha);
                })
      .low;
}

GelTimeOf time_to_gel_of(const Resin& resin) {
  refuse_law(resin, LawUse::beams);
  refuse_turbidity(resin, "printing by beams");
  refuse_shrinkage(resin, "printing by beams");
  const double factor = resin.dose_factor > 0 ? resin.dose_factor : 1;
  if (resin.has_gel_time()) {
    const GelTime g{resin.gel_a_mj_cm2 / factor, resin.gel_b_sqrt_mw_cm2_s / factor};
    return [g](double mw_cm2) { return mw_cm2 > 0 ? gel_time_s(g, mw_cm2) : kInfinite; };
  }
  const double per_cm = curing_absorption_per_cm(resin);
  const double before = resin.inhibition_dose_mj_cm3;
  if (resin.critical_dose_prime > 0) {
    const double gel = resin.critical_dose_prime / factor;
    return [gel, before, per_cm, m = resin.m](double mw_cm2) {
      return mw_cm2 > 0 ? before / (per_cm * mw_cm2) + gel / std::pow(mw_cm2, m) : kInfinite;
    };
  }
  const double gel =
      resin.gel_dose_mj_cm3 > 0 ? resin.gel_dose_mj_cm3 : resin.critical_dose_mj_cm3 / factor;
  return [dose = gel + before, per_cm](double mw_cm2) {
    return mw_cm2 > 0 ? dose / (per_cm * mw_cm2) : kInfinite;
  };
}

double TimeWindow::middle_s() const {
  return std::isfinite(last_s) ? std::sqrt(first_s * last_s) : 2 * first_s;
}

TimeWindow time_window(const BeamFigures& figures, const GelTimeOf& gel_time,
                       double brightest_mw_cm2) {
  return {gel_time(figures.least_inside * brightest_mw_cm2),
          gel_time(figures.most_outside * brightest_mw_cm2)};
}

}  // namespace slicecorr::tomo
