#include "base/band_tape.hpp"
#include "base/kernels.hpp"
#include "pipeline/bands.hpp"
#include "slicecorr/places.hpp"
#include "slicecorr/recording.hpp"
#include "slicecorr/volume.hpp"

namespace slicecorr {

using detail::BandTape;
using detail::columns_of;

namespace {

/// The numbers of the model that the loop needs.
struct Factors {
  double a, one_minus_a, r, one_minus_r;
};

/// Per column of a band: doses so far, and what its voxels of the present layer of cells were.
struct Columns {
  explicit Columns(std::size_t n)
      : omega(n, 0.0), phi(n), printed(n), designed(n), flags(n), wrong(n, 0) {}
  std::vector<double> omega, phi;
  std::vector<std::uint32_t> printed, designed;
  std::vector<std::uint8_t> flags;
  std::vector<std::uint32_t> wrong;  ///< of all layers
};

/// Steps all columns through one layer.
SLICECORR_CLONES
void step(const Factors f, std::size_t n, const double* __restrict phi, double* __restrict omega,
          const std::uint8_t* __restrict cover, std::uint32_t* __restrict printed,
          std::uint32_t* __restrict designed, std::uint8_t* __restrict flags,
          std::uint32_t* __restrict wrong) {
  for (std::size_t i = 0; i < n; ++i) {
    const double middle = phi[i] * f.one_minus_r + f.r * omega[i];
    omega[i] = phi[i] * f.one_minus_a + f.a * omega[i];
    const std::uint32_t prints = middle >= 1.0;
    const std::uint32_t empty = cover[i] == 0, full = cover[i] == 255;
    const std::uint32_t through = empty & prints, under = full & (1U - prints);
    printed[i] += prints;
    designed[i] += cover[i] >= 128;
    wrong[i] += through + under;
    flags[i] = static_cast<std::uint8_t>(flags[i] | through * kCellCureThrough |
                                         under * kCellUndercure | (1U - empty - full) * kCellGrey);
  }
}

/// The same where the doses in the middle of the layer are known.
SLICECORR_CLONES
void count(std::size_t n, const double* __restrict middle, const std::uint8_t* __restrict cover,
           std::uint32_t* __restrict printed, std::uint32_t* __restrict designed,
           std::uint8_t* __restrict flags, std::uint32_t* __restrict wrong) {
  for (std::size_t i = 0; i < n; ++i) {
    const std::uint32_t prints = middle[i] >= 1.0;
    const std::uint32_t empty = cover[i] == 0, full = cover[i] == 255;
    const std::uint32_t through = empty & prints, under = full & (1U - prints);
    printed[i] += prints;
    designed[i] += cover[i] >= 128;
    wrong[i] += through + under;
    flags[i] = static_cast<std::uint8_t>(flags[i] | through * kCellCureThrough |
                                         under * kCellUndercure | (1U - empty - full) * kCellGrey);
  }
}

void push(ReducedVolume::Runs& runs, std::uint8_t value) {
  if (runs.empty() || runs.back().first != value) runs.emplace_back(value, 0);
  ++runs.back().second;
}

/// How well a pixel stands for its cell; greater is better.
struct Rank {
  std::int64_t wrong_after = -1, wrong_before = -1, off_middle = 0;
  auto operator<=>(const Rank&) const = default;
};

/// `BandPredictor` of all columns of a band, each with the model of its place.
class PlacePredictor {
 public:
  PlacePredictor(const PlaceModels& models, int layers, const PixelBox& band) {
    if (models.even()) {
      add(models, models.map().reference(), layers, columns_of(band), {});
      return;
    }
    for (LightGroup& g : light_groups(models.map(), band, nullptr)) {
      const std::size_t size = g.columns.size();
      add(models, g.value, layers, size, std::move(g.columns));
    }
    pixels_.resize(columns_of(band));
    cover_.resize(columns_of(band));
    middle_.resize(columns_of(band));
  }
  void tell_edges(const BandPredictor::EdgeSink& sink) {
    for (Part& part : parts_) {
      if (part.columns.empty()) {
        part.predictor->tell_edges(sink);
        continue;
      }
      part.predictor->tell_edges(
          [sink, &columns = part.columns](std::size_t k, int node, bool upper, double um) {
            sink(columns[k], node, upper, um);
          });
    }
  }
  void add_slice(int slice, const std::uint8_t* pixels, const std::uint8_t* coverage) {
    for (Part& part : parts_) {
      const auto& columns = part.columns;
      if (columns.empty()) {
        part.predictor->add_slice(slice, pixels, coverage);
        continue;
      }
      for (std::size_t k = 0; k < columns.size(); ++k) {
        if (pixels) pixels_[k] = pixels[columns[k]];
        cover_[k] = coverage[columns[k]];
      }
      part.predictor->add_slice(slice, pixels ? pixels_.data() : nullptr, cover_.data());
      if (part.plain) continue;
      for (std::size_t k = 0; k < columns.size(); ++k) {
        middle_[columns[k]] = part.predictor->middle()[k];
      }
    }
  }
  const double* middle() const {
    return middle_.empty() ? parts_[0].predictor->middle() : middle_.data();
  }
  /// Tells the edges at the platform. Figures are not kept.
  void finish() {
    for (Part& part : parts_) part.predictor->finish(0, 0, 1);
  }

 private:
  struct Part {
    std::unique_ptr<BandPredictor> predictor;
    std::vector<std::uint32_t> columns;  ///< empty: all of the band
    bool plain;
  };
  void add(const PlaceModels& models, std::uint8_t value, int layers, std::size_t size,
           std::vector<std::uint32_t> columns) {
    parts_.reserve(256);  // edges are told with references into the parts
    parts_.push_back(
        {std::make_unique<BandPredictor>(models.model(value), models.curve(value), layers, size),
         std::move(columns), models.model(value).is_plain()});
    parts_.back().predictor->keep_no_histograms();
  }
  std::vector<Part> parts_;
  std::vector<std::uint8_t> pixels_, cover_;
  std::vector<double> middle_;
};

/// Works on rows of cells; different rows may be worked on at once.
class Reducer {
 public:
  Reducer(const SliceSource& stack, const SliceSource& target, const Setup& setup, int most_cells,
          const Job& job)
      : stack_(stack),
        target_(target),
        job_(job),
        models_(setup.printer, setup.resin, setup.process, stack.grid(), stack.frame()),
        model_(models_.brightest()),
        levels_(setup.printer.levels()) {
    volume_.box = stack.bounds().united(target.bounds());
    if (volume_.box.empty()) return;
    ReducedVolume& v = volume_;
    v.layers = std::max(stack.grid().layers, target.grid().layers);
    const auto fit = [&](int size, int& step, int& cells) {
      step = (size + most_cells - 1) / most_cells;
      cells = (size + step - 1) / step;
    };
    fit(v.box.width(), v.step_x, v.nx);
    fit(v.box.height(), v.step_y, v.ny);
    fit(v.layers, v.step_z, v.nz);
    for (ReducedPrint* p : {&v.before, &v.after}) {
      for (auto* grid : {&p->state, &p->dose, &p->grey, &p->error}) grid->assign(v.cells(), 0);
    }
    v.columns.resize(static_cast<std::size_t>(v.nx) * static_cast<std::size_t>(v.ny));
    rows_ = band_rows(stack.grid());
    cell_rows_ = std::max(1, rows_ / v.step_y);
  }

  std::size_t items() const {
    return static_cast<std::size_t>((volume_.ny + cell_rows_ - 1) / cell_rows_);
  }

  /// The cell rows of one item: read in bands of a bounded number of image rows.
  void reduce(std::size_t item) {
    const int j0 = static_cast<int>(item) * cell_rows_;
    const int j1 = std::min(volume_.ny, j0 + cell_rows_);
    const int y0 = volume_.box.y0 + j0 * volume_.step_y;
    const int y1 = std::min(volume_.box.y1, volume_.box.y0 + j1 * volume_.step_y);
    const auto layer = static_cast<std::size_t>(j1 - j0) * static_cast<std::size_t>(volume_.nx);
    Item work{j0, j1, std::vector<Rank>(layer), {}, {}};
    for (auto* counts : {&work.before, &work.after}) {
      counts->printed.assign(layer * static_cast<std::size_t>(volume_.nz), 0);
    }
    work.before.designed.assign(work.before.printed.size(), 0);
    for (int y = y0; y < y1; y += rows_) {
      read_band(work, {volume_.box.x0, y, volume_.box.x1, std::min(y + rows_, y1)});
    }
    settle(work);
  }

  ReducedVolume take() { return std::move(volume_); }

 private:
  /// Sums over bands of the voxels of each cell.
  struct Counts {
    std::vector<std::uint64_t> printed, designed;
  };
  struct Item {
    int j0, j1;
    std::vector<Rank> ranks;  ///< of the columns that stand so far
    Counts before, after;
  };

  std::size_t cell(int i, int j, int k) const {
    return (static_cast<std::size_t>(k) * static_cast<std::size_t>(volume_.ny) +
            static_cast<std::size_t>(j)) *
               static_cast<std::size_t>(volume_.nx) +
           static_cast<std::size_t>(i);
  }
  std::size_t cell_in(const Item& w, int i, int j, int k) const {
    return (static_cast<std::size_t>(k) * static_cast<std::size_t>(w.j1 - w.j0) +
            static_cast<std::size_t>(j - w.j0)) *
               static_cast<std::size_t>(volume_.nx) +
           static_cast<std::size_t>(i);
  }

  void read_band(Item& work, const PixelBox& band) {
    const std::size_t n = columns_of(band);
    BandTape shown(n), design(n);
    stack_.read_band(band, [&](int, const std::uint8_t* rows) { shown.append(rows); });
    target_.read_band(band, [&](int, const std::uint8_t* rows) { design.append(rows); });
    const Factors f{model_.a, model_.one_minus_a, model_.root_a, 1.0 - model_.root_a};
    Columns before(n), after(n);
    PlacePredictor edges_before(models_, volume_.layers, band);
    PlacePredictor edges_after(models_, volume_.layers, band);
    edges_before.tell_edges(mark_errors(volume_.before.error, band));
    edges_after.tell_edges(mark_errors(volume_.after.error, band));
    // The curve of pixel values of each column.
    std::vector<std::uint8_t> light(n);
    models_.map().values(band, light.data());
    std::array<const double*, 256> curves{};
    for (const std::uint8_t v : light) {
      if (!curves[v]) curves[v] = models_.curve(v).data();
    }
    std::vector<std::uint8_t> pixels(n), cover(n);
    for (int z = volume_.layers; z-- > 0;) {
      if ((z & 63) == 0) job_.check_cancelled();
      const bool last = z + 1 == volume_.layers || (z + 1) % volume_.step_z == 0;
      shown.read(z, pixels.data());
      design.read(z, cover.data());
      const auto go = [&](Columns& c, PlacePredictor& edges, const std::uint8_t* values) {
        if (last) {
          std::fill(c.printed.begin(), c.printed.end(), 0U);
          std::fill(c.designed.begin(), c.designed.end(), 0U);
          std::fill(c.flags.begin(), c.flags.end(), std::uint8_t{0});
        }
        edges.add_slice(z, values, cover.data());
        if (!model_.is_plain()) {
          count(n, edges.middle(), cover.data(), c.printed.data(), c.designed.data(),
                c.flags.data(), c.wrong.data());
          return;
        }
        if (models_.even()) {
          const double* curve = curves[light[0]];
          for (std::size_t i = 0; i < n; ++i) c.phi[i] = values ? curve[values[i]] : 0.0;
        } else {
          for (std::size_t i = 0; i < n; ++i) {
            c.phi[i] = values ? curves[light[i]][values[i]] : 0.0;
          }
        }
        step(f, n, c.phi.data(), c.omega.data(), cover.data(), c.printed.data(), c.designed.data(),
             c.flags.data(), c.wrong.data());
      };
      go(before, edges_before, z < target_.grid().layers ? cover.data() : nullptr);
      go(after, edges_after, z < stack_.grid().layers ? pixels.data() : nullptr);
      if (z % volume_.step_z == 0) {
        fold(work, band, z / volume_.step_z, before, volume_.before, work.before);
        fold(work, band, z / volume_.step_z, after, volume_.after, work.after);
      }
    }
    edges_before.finish();
    edges_after.finish();
    keep_columns(work, band, shown, design, before, after);
  }

  /// Joins a layer of cells' worth of columns into the cells.
  void fold(const Item& work, const PixelBox& band, int k, const Columns& c, ReducedPrint& print,
            Counts& counts) const {
    std::size_t at = 0;
    for (int y = band.y0; y < band.y1; ++y) {
      const int j = (y - volume_.box.y0) / volume_.step_y;
      for (int i = 0; i < volume_.nx; ++i) {
        const int end = std::min(volume_.box.width(), (i + 1) * volume_.step_x);
        std::uint8_t flags = 0;
        std::uint64_t printed = 0, designed = 0;
        for (int x = i * volume_.step_x; x < end; ++x, ++at) {
          flags |= c.flags[at];
          printed += c.printed[at];
          designed += c.designed[at];
        }
        print.state[cell(i, j, k)] |= flags;
        const std::size_t in = cell_in(work, i, j, k);
        counts.printed[in] += printed;
        if (!counts.designed.empty()) counts.designed[in] += designed;
      }
    }
  }

  /// Colours the cells from the designed edge to the printed one. Bands of one item are read one
  /// after the other and no other item has these cells.
  BandPredictor::EdgeSink mark_errors(std::vector<std::uint8_t>& error, const PixelBox& band) {
    return [this, &error, band](std::size_t column, int node, bool upper, double um) {
      const auto width = static_cast<std::size_t>(band.width());
      const int i = static_cast<int>(column % width) / volume_.step_x;
      const int j = (band.y0 - volume_.box.y0 + static_cast<int>(column / width)) / volume_.step_y;
      const double printed = node + (upper ? -um : um) / model_.layer_um;
      const std::uint8_t code = error_code(um);
      const auto mark = [&](int k) {
        std::uint8_t& old = error[cell(i, j, k)];
        // Of equals the positive one, so that the order does not matter.
        const int mine = std::abs(code - 128), theirs = old ? std::abs(old - 128) : -1;
        if (mine > theirs || (mine == theirs && code > old)) old = code;
      };
      // The layer of the run beside the edge, and on to where the print ends.
      const int inside = upper ? node : node - 1;
      const int to = std::clamp(static_cast<int>(printed), 0, volume_.layers - 1);
      const int k0 = std::min(inside, to) / volume_.step_z;
      const int k1 = std::max(inside, to) / volume_.step_z;
      for (int k = k0; k <= k1; ++k) mark(k);
    };
  }

  /// Chooses the pixels that stand for columns of cells, and takes their slices.
  void keep_columns(Item& work, const PixelBox& band, const BandTape& shown, const BandTape& design,
                    const Columns& before, const Columns& after) {
    struct Chosen {
      std::size_t at = 0, cells = 0;
      int i = 0, j = 0;
    };
    const auto width = static_cast<std::size_t>(volume_.nx);
    std::vector<std::ptrdiff_t> best(work.ranks.size(), -1);
    std::size_t at = 0;
    for (int y = band.y0; y < band.y1; ++y) {
      const int j = (y - volume_.box.y0) / volume_.step_y;
      for (int x = 0; x < band.width(); ++x, ++at) {
        const int i = x / volume_.step_x;
        const std::int64_t dx = 2 * (x % volume_.step_x) + 1 - volume_.step_x;
        const std::int64_t dy = 2 * ((y - volume_.box.y0) % volume_.step_y) + 1 - volume_.step_y;
        const Rank rank{after.wrong[at], before.wrong[at], -(dx * dx + dy * dy)};
        const std::size_t c =
            static_cast<std::size_t>(j - work.j0) * width + static_cast<std::size_t>(i);
        if (rank > work.ranks[c]) {
          work.ranks[c] = rank;
          best[c] = static_cast<std::ptrdiff_t>(at);
        }
      }
    }
    std::vector<Chosen> chosen;
    std::vector<Pixel> places;
    for (std::size_t c = 0; c < best.size(); ++c) {
      if (best[c] < 0) continue;
      Chosen one;
      one.at = static_cast<std::size_t>(best[c]);
      one.i = static_cast<int>(c % width);
      one.j = work.j0 + static_cast<int>(c / width);
      one.cells = static_cast<std::size_t>(one.j) * width + static_cast<std::size_t>(one.i);
      const auto band_width = static_cast<std::size_t>(band.width());
      const Pixel at_pixel{band.x0 + static_cast<int>(one.at % band_width),
                           band.y0 + static_cast<int>(one.at / band_width)};
      const LightMap& map = models_.map();
      volume_.columns[one.cells] = {
          at_pixel.x, at_pixel.y, map.factor(map.value(at_pixel.x, at_pixel.y)), {}, {}};
      chosen.push_back(one);
      places.push_back(at_pixel);
    }
    if (chosen.empty()) return;
    PlaceDose dose_before(models_, places), dose_after(models_, places);
    std::vector<std::uint8_t> chosen_pixels(chosen.size()), chosen_cover(chosen.size());
    std::vector<std::uint8_t> pixels(band.width() * static_cast<std::size_t>(band.height())),
        cover(pixels.size());
    for (int z = volume_.layers; z-- > 0;) {
      shown.read(z, pixels.data());
      design.read(z, cover.data());
      const int k = z / volume_.step_z;
      const int first = k * volume_.step_z;
      const int middle = (first + std::min(first + volume_.step_z, volume_.layers)) / 2;
      const bool lit_before = z < target_.grid().layers, lit_after = z < stack_.grid().layers;
      for (std::size_t m = 0; m < chosen.size(); ++m) {
        chosen_cover[m] = cover[chosen[m].at];
        chosen_pixels[m] = pixels[chosen[m].at];
      }
      dose_before.add_slice(z, lit_before ? chosen_cover.data() : nullptr);
      dose_after.add_slice(z, lit_after ? chosen_pixels.data() : nullptr);
      for (std::size_t m = 0; m < chosen.size(); ++m) {
        const Chosen& one = chosen[m];
        const std::uint8_t c = chosen_cover[m], p = chosen_pixels[m];
        ReducedVolume::Column& column = volume_.columns[one.cells];
        if (lit_before) push(column.coverage, c);
        if (lit_after) {
          push(column.levels, static_cast<std::uint8_t>(level_of_pixel(p, levels_)));
        }
        if (z == middle) {
          const std::size_t to = cell(one.i, one.j, k);
          volume_.before.dose[to] = dose_code(dose_before.middle()[m]);
          volume_.after.dose[to] = dose_code(dose_after.middle()[m]);
          volume_.before.grey[to] = c;
          volume_.after.grey[to] = p;
        }
      }
    }
    for (const Chosen& one : chosen) {
      ReducedVolume::Column& column = volume_.columns[one.cells];
      for (auto* runs : {&column.coverage, &column.levels}) {
        std::reverse(runs->begin(), runs->end());
        runs->shrink_to_fit();
      }
    }
  }

  /// Counts to flags.
  void settle(const Item& work) {
    const auto size = [](int at, int step, int all) { return std::min(step, all - at * step); };
    for (int k = 0; k < volume_.nz; ++k) {
      for (int j = work.j0; j < work.j1; ++j) {
        for (int i = 0; i < volume_.nx; ++i) {
          const std::uint64_t voxels =
              static_cast<std::uint64_t>(size(i, volume_.step_x, volume_.box.width())) *
              static_cast<std::uint64_t>(size(j, volume_.step_y, volume_.box.height())) *
              static_cast<std::uint64_t>(size(k, volume_.step_z, volume_.layers));
          const std::size_t in = cell_in(work, i, j, k), out = cell(i, j, k);
          const std::uint8_t design = 2 * work.before.designed[in] >= voxels ? kCellDesigned : 0;
          const auto printed = [&](const Counts& counts) {
            return 2 * counts.printed[in] >= voxels ? kCellPrinted : 0;
          };
          volume_.before.state[out] |= static_cast<std::uint8_t>(design | printed(work.before));
          volume_.after.state[out] |= static_cast<std::uint8_t>(design | printed(work.after));
        }
      }
    }
  }

  const SliceSource& stack_;
  const SliceSource& target_;
  const Job& job_;
  PlaceModels models_;
  const CureModel& model_;  ///< what does not depend on the place
  int levels_, rows_ = 1, cell_rows_ = 1;
  ReducedVolume volume_;
};

}  // namespace

ReducedVolume reduce_volume(const SliceSource& stack, const SliceSource& target, const Setup& setup,
                            int most_cells, const Job& job) {
  refuse_recording(stack);
  check_same_voxels(stack.grid(), target.grid());
  Reducer reducer(stack, target, setup, most_cells, job);
  parallel_for(job, "look", reducer.items(), [&](std::size_t item) { reducer.reduce(item); });
  return reducer.take();
}

ReducedVolume coarser(const ReducedVolume& fine) {
  ReducedVolume v;
  v.box = fine.box;
  v.layers = fine.layers;
  v.step_x = fine.step_x * 2;
  v.step_y = fine.step_y * 2;
  v.step_z = fine.step_z * 2;
  v.nx = (fine.nx + 1) / 2;
  v.ny = (fine.ny + 1) / 2;
  v.nz = (fine.nz + 1) / 2;
  const auto join = [&](const ReducedPrint& from, ReducedPrint& to) {
    for (auto* grid : {&to.state, &to.dose, &to.grey, &to.error}) grid->assign(v.cells(), 0);
    std::vector<std::uint8_t> printed(v.cells(), 0), designed(v.cells(), 0), all(v.cells(), 0);
    std::size_t at = 0;
    for (int k = 0; k < fine.nz; ++k) {
      for (int j = 0; j < fine.ny; ++j) {
        for (int i = 0; i < fine.nx; ++i, ++at) {
          const std::size_t c = (static_cast<std::size_t>(k / 2) * static_cast<std::size_t>(v.ny) +
                                 static_cast<std::size_t>(j / 2)) *
                                    static_cast<std::size_t>(v.nx) +
                                static_cast<std::size_t>(i / 2);
          const std::uint8_t s = from.state[at];
          to.state[c] |= s & (kCellCureThrough | kCellUndercure | kCellGrey);
          printed[c] = static_cast<std::uint8_t>(printed[c] + ((s & kCellPrinted) != 0));
          designed[c] = static_cast<std::uint8_t>(designed[c] + ((s & kCellDesigned) != 0));
          ++all[c];
          const std::uint8_t e = from.error[at];
          if (e && (!to.error[c] || std::abs(e - 128) > std::abs(to.error[c] - 128)))
            to.error[c] = e;
          if (i % 2 == 0 && j % 2 == 0 && k % 2 == 0) {
            to.dose[c] = from.dose[at];
            to.grey[c] = from.grey[at];
          }
        }
      }
    }
    for (std::size_t c = 0; c < v.cells(); ++c) {
      if (2 * printed[c] >= all[c]) to.state[c] |= kCellPrinted;
      if (2 * designed[c] >= all[c]) to.state[c] |= kCellDesigned;
    }
  };
  join(fine.before, v.before);
  join(fine.after, v.after);
  v.columns.reserve(static_cast<std::size_t>(v.nx) * static_cast<std::size_t>(v.ny));
  for (int j = 0; j < v.ny; ++j) {
    for (int i = 0; i < v.nx; ++i) {
      v.columns.push_back(
          fine.columns[static_cast<std::size_t>(2 * j) * static_cast<std::size_t>(fine.nx) +
                       static_cast<std::size_t>(2 * i)]);
    }
  }
  return v;
}

}  // namespace slicecorr
