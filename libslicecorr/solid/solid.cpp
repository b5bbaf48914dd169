// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/solid.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <functional>
#include <limits>
#include <vector>

#include "base/coded_band.hpp"
#include "cure/shown_slices.hpp"
#include "cure/spread_band.hpp"
#include "slicecorr/dose.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/stack.hpp"
#include "solid/after_print.hpp"
#include "solid/level_surface.hpp"
#include "solid/mesh_file.hpp"
#include "solid/on_plate.hpp"
#include "stack/blob_store.hpp"

namespace slicecorr {

using detail::OnPlate;
using detail::shown_box;
using detail::Triangle;

namespace {

constexpr std::size_t kMemoryBudget = std::size_t{256} << 20;
/// Triangles that are handed to the store at once.
constexpr std::size_t kPiece = 16384;

/// Every Nth pixel along an image axis, with one to each side of what is lit.
struct Axis {
  int reduce, pixels;
  int first, count;  ///< samples [first, first + count)
  Axis(int low, int high, int every, int image) : reduce(every), pixels(image) {
    first = low / every - 1;
    count = (high - 1) / every + 2 - first;
  }
  int pixel(int i) const { return (first + i) * reduce + (first + i < 0 ? 0 : reduce / 2); }
  bool in_image(int i) const { return first + i >= 0 && pixel(i) < pixels; }
  /// Middle of the pixel, in pixels.
  double middle(int i) const {
    const int at = (first + i) * reduce + reduce / 2;
    return at + 0.5;
  }
};

/// The surface cut up into blobs of triangles, in the order of the bands.
struct PrintedSurface {
  std::unique_ptr<BlobStore> store;
  std::vector<std::vector<BlobStore::Blob>> bands;
  SolidReport report;

  detail::Triangles triangles() const {
    return [this](const detail::LevelSurface::Sink& sink) {
      std::vector<std::uint8_t> bytes;
      for (const auto& blobs : bands) {
        for (const BlobStore::Blob& blob : blobs) {
          bytes.clear();
          store->get(blob, bytes);
          for (std::size_t at = 0; at < bytes.size(); at += sizeof(Triangle)) {
            Triangle t;
            std::memcpy(&t, bytes.data() + at, sizeof t);
            sink(t);
          }
        }
      }
    };
  }
};

/// What a part of a surface measures.
struct Surveyed {
  std::uint64_t triangles = 0;
  double volume = 0;
  Point3 lower{}, upper{};
  Histogram distance_um;
  Surveyed() {
    lower.fill(std::numeric_limits<double>::infinity());
    upper.fill(-std::numeric_limits<double>::infinity());
  }
  void add(const Triangle& t) {
    double p[3][3];
    for (std::size_t i = 0; i < 3; ++i) {
      for (std::size_t k = 0; k < 3; ++k) {
        p[i][k] = static_cast<double>(t[i][k]);
        lower[k] = std::min(lower[k], p[i][k]);
        upper[k] = std::max(upper[k], p[i][k]);
      }
    }
    volume += (p[0][0] * (p[1][1] * p[2][2] - p[1][2] * p[2][1]) +
               p[0][1] * (p[1][2] * p[2][0] - p[1][0] * p[2][2]) +
               p[0][2] * (p[1][0] * p[2][1] - p[1][1] * p[2][0])) /
              6.0;
    ++triangles;
  }
};

bool wanted(const SolidOptions& options, const Triangle& t) {
  if (!options.wanted) return true;
  Point3 low, high;
  for (std::size_t k = 0; k < 3; ++k) {
    const auto [least, most] = std::minmax({t[0][k], t[1][k], t[2][k]});
    low[k] = static_cast<double>(least);
    high[k] = static_cast<double>(most);
  }
  return options.wanted(low, high);
}

/// One band of samples, from the last slice to the first.
class BandSurface {
 public:
  BandSurface(const SliceSource& stack, const PlaceModels& models,
              const detail::SpreadLight& spread, const OnPlate& plate,
              const detail::AfterPrint& after, const SolidOptions& options, const Axis& columns,
              const Axis& rows, BlobStore* store)
      : stack_(stack),
        models_(models),
        model_(models.brightest()),
        plate_(plate),
        after_(after),
        options_(options),
        slices_(stack),
        spread_(spread),
        columns_(columns),
        rows_(rows),
        store_(store) {}

  Surveyed surveyed;
  std::vector<BlobStore::Blob> blobs;
  std::vector<Triangle> low;  ///< not among these: the first layers, which move together

  /// Samples rows [row, row + height).
  void draw(int row, int height, const ExecutionContext& context) {
    const auto width = static_cast<std::size_t>(columns_.count);
    const std::size_t samples = width * static_cast<std::size_t>(height);
    const Grid& grid = stack_.grid();
    std::vector<double> x_mm, y_mm;
    for (int i = 0; i < columns_.count; ++i) {
      x_mm.push_back(columns_.middle(i) * grid.pixel_x_um * 1e-3);
    }
    for (int j = 0; j < height; ++j) {
      y_mm.push_back((grid.height_px - rows_.middle(row + j)) * grid.pixel_y_um * 1e-3);
    }
    const detail::CodedBand coded = spread_.none() ? read(row, height) : detail::CodedBand(samples);
    // Beside the image there is no light at all, in it at least that of black.
    std::vector<double> dark(samples);
    std::vector<const PixelCurve*> curves(samples);
    std::vector<Pixel> pixels(samples);
    std::vector<std::uint8_t> in_image(samples, 1);
    for (int j = 0; j < height; ++j) {
      for (int i = 0; i < columns_.count; ++i) {
        const std::size_t at = static_cast<std::size_t>(j) * width + static_cast<std::size_t>(i);
        if (!columns_.in_image(i) || !rows_.in_image(row + j)) {
          in_image[at] = 0;
          // Any place: what is computed for it is not used.
          pixels[at] = {0, 0};
          curves[at] = nullptr;
          dark[at] = 0;
          continue;
        }
        pixels[at] = {columns_.pixel(i), rows_.pixel(row + j)};
        curves[at] = &models_.curve(models_.map().value(pixels[at].x, pixels[at].y));
        dark[at] = (*curves[at])[0];
      }
    }
    detail::LevelSurface::VertexSink measure;
    if (options_.design) {
      measure = [&](const Point3& vertex) {
        Point3 p = vertex;
        plate_.place(p[0], p[1]);
        if (after_.is_low(p[2])) return;
        surveyed.distance_um.add(options_.design->to(after_.shrunk(p)) * 1e3);
      };
    }
    detail::LevelSurface surface(
        model_, std::move(x_mm), std::move(y_mm), [&](const Triangle& t) { take(t); }, measure);
    if (!spread_.none()) {
      draw_spread(surface, in_image, pixels, context);
    } else if (model_.is_plain() || (model_.is_continuous() && !model_.heights.alike())) {
      draw_plain(surface, coded, dark, curves, context);
    } else {
      draw_general(surface, coded, in_image, pixels, context);
    }
    flush();
  }

 private:
  void draw_plain(detail::LevelSurface& surface, const detail::CodedBand& coded,
                  const std::vector<double>& dark, const std::vector<const PixelCurve*>& curves,
                  const ExecutionContext& context) const {
    std::vector<std::uint8_t> pixels(dark.size());
    std::vector<double> phi(dark), below(dark.size(), 0.0), above(dark.size());
    detail::ShownBand shown(slices_, coded);
    for (int n = slices_.slices(); n-- > 0;) {
      if ((n & 63) == 0) context.check_cancelled();
      if (slices_.recorded()) {
        std::fill(phi.begin(), phi.end(), 0.0);
        for (const ImageShowing& part : shown.of(n)) {
          for (std::size_t i = 0; i < dark.size(); ++i) {
            if (curves[i]) phi[i] += part.light * (*curves[i])[part.pixels[i]];
          }
        }
      } else if (coded.black(n)) {
        phi = dark;
      } else {
        coded.read(n, pixels.data());
        for (std::size_t i = 0; i < dark.size(); ++i) {
          phi[i] = pixels[i] ? (*curves[i])[pixels[i]] : dark[i];
        }
      }
      const double ratio = model_.ratio(n);
      for (std::size_t i = 0; i < dark.size(); ++i) {
        phi[i] *= ratio;
        above[i] = model_.step_in(n, phi[i], below[i]);
      }
      surface.layer(n, phi.data(), below.data(), above.data());
      below.swap(above);
    }
    surface.platform(below.data());
  }

  /// `in_image`: 0 for the samples beside the image.
  void draw_general(detail::LevelSurface& surface, const detail::CodedBand& coded,
                    const std::vector<std::uint8_t>& in_image, const std::vector<Pixel>& places,
                    const ExecutionContext& context) const {
    const std::size_t samples = in_image.size();
    std::vector<std::uint8_t> pixels(samples);
    std::vector<double> node(samples, 0.0), lower(samples), upper(samples);
    PlaceDose dose(models_, places);
    detail::ShownBand shown(slices_, coded);
    for (int n = slices_.slices(); n-- > 0;) {
      if ((n & 63) == 0) context.check_cancelled();
      if (slices_.recorded()) {
        dose.add_slice(n, shown.of(n));
      } else {
        coded.read(n, pixels.data());
        dose.add_slice(n, pixels.data());
      }
      for (std::size_t i = 0; i < samples; ++i) {
        lower[i] = in_image[i] ? dose.lower()[i] : 0.0;
        upper[i] = in_image[i] ? dose.upper()[i] : 0.0;
      }
      surface.jump(n + 1, node.data(), lower.data());
      surface.layer(n, lower.data(), upper.data());
      node = upper;
    }
    surface.platform(node.data());
  }

  /// Columns that light reaches from others. As `draw_general`.
  void draw_spread(detail::LevelSurface& surface, const std::vector<std::uint8_t>& in_image,
                   const std::vector<Pixel>& places, const ExecutionContext& context) const {
    const std::size_t samples = in_image.size();
    PixelBox window;
    std::vector<Pixel> inside = places;
    for (std::size_t i = 0; i < samples; ++i) {
      const Pixel& p = places[i];
      if (in_image[i]) window = window.united({p.x, p.y, p.x + 1, p.y + 1});
    }
    for (std::size_t i = 0; i < samples; ++i) {
      if (!in_image[i]) inside[i] = {window.x0, window.y0};
    }
    detail::SpreadBand light(spread_, stack_, slices_, window, inside);
    BandDose dose(spread_.model(), samples);
    std::vector<double> node(samples, 0.0), lower(samples), upper(samples), phi(samples);
    for (int n = slices_.slices(); n-- > 0;) {
      if ((n & 63) == 0) context.check_cancelled();
      const std::span<const ImageShowing> showings = light.of(n);
      dose.add_slice(n, showings);
      for (std::size_t i = 0; i < samples; ++i) {
        lower[i] = in_image[i] ? dose.lower()[i] : 0.0;
        upper[i] = in_image[i] ? dose.upper()[i] : 0.0;
      }
      if (model_.is_plain()) {
        std::fill(phi.begin(), phi.end(), 0.0);
        for (const ImageShowing& showing : showings) {
          for (std::size_t i = 0; i < samples; ++i) {
            if (in_image[i]) phi[i] += showing.light * showing.phi[i];
          }
        }
        surface.layer(n, phi.data(), lower.data(), upper.data());
        node = upper;
        continue;
      }
      surface.jump(n + 1, node.data(), lower.data());
      surface.layer(n, lower.data(), upper.data());
      node = upper;
    }
    surface.platform(node.data());
  }

  detail::CodedBand read(int row, int height) const {
    const auto width = static_cast<std::size_t>(columns_.count);
    detail::CodedBand coded(width * static_cast<std::size_t>(height));
    const PixelBox lit = stack_.bounds();
    const PixelBox box{lit.x0, std::clamp(rows_.pixel(row), lit.y0, lit.y1), lit.x1,
                       std::clamp(rows_.pixel(row + height - 1) + 1, lit.y0, lit.y1)};
    if (box.empty()) {
      for (int n = 0; n < stack_.grid().layers; ++n) coded.append(nullptr);
      return coded;
    }
    std::vector<std::uint8_t> sampled(width * static_cast<std::size_t>(height));
    stack_.read_band(box, [&](int, const std::uint8_t* pixels) {
      if (!pixels) return coded.append(nullptr);
      std::uint8_t* out = sampled.data();
      for (int j = 0; j < height; ++j) {
        const int y = rows_.pixel(row + j);
        for (int i = 0; i < columns_.count; ++i, ++out) {
          const int x = columns_.pixel(i);
          const bool inside = x >= box.x0 && x < box.x1 && y >= box.y0 && y < box.y1 &&
                              columns_.in_image(i) && rows_.in_image(row + j);
          *out = inside
                     ? pixels[static_cast<std::ptrdiff_t>(y - box.y0) * box.width() + (x - box.x0)]
                     : std::uint8_t{0};
        }
      }
      coded.append(sampled.data());
    });
    return coded;
  }

  void take(Triangle t) {
    plate_.place(t);
    if (after_.is_low(t)) {
      low.push_back(t);
      return;
    }
    after_.shrink(t);
    if (!wanted(options_, t)) return;
    surveyed.add(t);
    if (!store_) return;
    waiting_.push_back(t);
    if (waiting_.size() >= kPiece) flush();
  }
  void flush() {
    if (waiting_.empty()) return;
    blobs.push_back(store_->put(reinterpret_cast<const std::uint8_t*>(waiting_.data()),
                                waiting_.size() * sizeof(Triangle)));
    waiting_.clear();
  }

  const SliceSource& stack_;
  const PlaceModels& models_;
  const CureModel& model_;  ///< what does not depend on the place
  const OnPlate& plate_;
  const detail::AfterPrint& after_;
  const SolidOptions& options_;
  const detail::ShownSlices slices_;
  const detail::SpreadLight& spread_;
  const Axis& columns_;
  const Axis& rows_;
  BlobStore* store_;  ///< null: triangles are counted only
  std::vector<Triangle> waiting_;
};

bool black_gels(const CureModel& model, const SliceSource& stack) {
  const int slices = stack.grid().layers;
  if (stack.recording()) {
    const detail::ShownSlices shown(stack);
    detail::BlackColumn black(shown);
    BandDose dose(model, 1);
    for (int n = shown.slices(); n-- > 0;) {
      dose.add_slice(n, black(n));
      if (*dose.lower() >= 1.0 || *dose.upper() >= 1.0) return true;
    }
    return false;
  }
  if (model.is_plain()) return model.phi_min() > 1.0;
  const ColumnDose dose =
      column_dose(model, std::vector<std::uint8_t>(static_cast<std::size_t>(slices), 0));
  const auto gels = [](double d) { return d >= 1.0; };
  return std::any_of(dose.lower.begin(), dose.lower.end(), gels) ||
         std::any_of(dose.upper.begin(), dose.upper.end(), gels);
}

detail::AfterPrint after_print(const SliceSource& stack, const Resin& resin) {
  const std::array<Point3, 2> box = shown_box(stack, 0);
  return {resin.shrinkage, 0.5 * (box[0][0] + box[1][0]), 0.5 * (box[0][1] + box[1][1])};
}

/// The first layers of all bands, which stand out, behind what else there is.
void grow_first_layers(std::vector<std::vector<Triangle>>& low, const detail::AfterPrint& after,
                       const SolidOptions& options, PrintedSurface& surface,
                       std::vector<Surveyed>& surveyed) {
  std::vector<Triangle> all;
  for (std::vector<Triangle>& its : low) {
    all.insert(all.end(), its.begin(), its.end());
    its = {};
  }
  Surveyed& own = surveyed.emplace_back();
  std::function<void(const Point3&)> measure;
  if (options.design) {
    measure = [&](const Point3& p) {
      own.distance_um.add(options.design->to(after.shrunk(p)) * 1e3);
    };
  }
  after.grow(all, measure);
  for (Triangle& t : all) after.shrink(t);
  all.erase(std::remove_if(all.begin(), all.end(),
                           [&](const Triangle& t) { return !wanted(options, t); }),
            all.end());
  for (const Triangle& t : all) own.add(t);
  if (!surface.store) return;
  std::vector<BlobStore::Blob>& blobs = surface.bands.emplace_back();
  for (std::size_t at = 0; at < all.size(); at += kPiece) {
    const std::size_t count = std::min(kPiece, all.size() - at);
    blobs.push_back(surface.store->put(reinterpret_cast<const std::uint8_t*>(all.data() + at),
                                       count * sizeof(Triangle)));
  }
}

/// `stage` names the progress; `keep`: whether triangles are kept, else they are counted only.
PrintedSurface surface_of(const SliceSource& stack, const PlaceModels& models,
                          const SolidOptions& options, const std::string& scratch_folder,
                          const char* stage, bool keep, const ExecutionContext& context) {
  if (options.reduce < 1 || options.reduce > 64) {
    throw InputError(fmt::format("every {}th pixel; expected 1 to 64", options.reduce));
  }
  if (models.brightest().inhibited()) detail::refuse_recording_under_uv(stack);
  const Grid& grid = stack.grid();
  PixelBox lit = stack.bounds();
  // Where even black gels, the whole display prints.
  if (black_gels(models.brightest(), stack)) lit = {0, 0, grid.width_px, grid.height_px};
  const detail::SpreadLight spread(models, grid, stack.frame());
  if (!spread.none()) lit = spread.around(lit);
  if (options.rows) {
    lit.y0 = std::max(lit.y0, (*options.rows)[0]);
    lit.y1 = std::min(lit.y1, (*options.rows)[1]);
  }
  const OnPlate plate(stack);
  PrintedSurface surface;
  if (keep) surface.store = std::make_unique<BlobStore>(scratch_folder, kMemoryBudget, context);
  surface.report.lower.fill(std::numeric_limits<double>::infinity());
  surface.report.upper.fill(-std::numeric_limits<double>::infinity());
  if (!lit.empty()) {
    const Axis columns(lit.x0, lit.x1, options.reduce, grid.width_px);
    const Axis rows(lit.y0, lit.y1, options.reduce, grid.height_px);
    const int height = std::max(1, band_rows(grid));
    // Bands share their last row with the next one's first: cells lie between rows.
    const auto bands = static_cast<std::size_t>((rows.count - 1 + height - 1) / height);
    surface.bands.resize(bands);
    std::vector<Surveyed> surveyed(bands);
    std::vector<std::vector<Triangle>> low(bands);
    const detail::AfterPrint after = after_print(stack, models.resin());
    parallel_for(context, stage, bands, [&](std::size_t b) {
      const int row = static_cast<int>(b) * height;
      BandSurface band(stack, models, spread, plate, after, options, columns, rows,
                       surface.store.get());
      band.draw(row, std::min(height + 1, rows.count - row), context);
      surface.bands[b] = std::move(band.blobs);
      surveyed[b] = std::move(band.surveyed);
      low[b] = std::move(band.low);
    });
    if (after.grows()) grow_first_layers(low, after, options, surface, surveyed);
    // In the order of the bands, so that no sum depends on threads.
    SolidReport& all = surface.report;
    for (const Surveyed& r : surveyed) {
      all.triangles += r.triangles;
      all.volume_mm3 += r.volume;
      for (std::size_t k = 0; k < 3; ++k) {
        all.lower[k] = std::min(all.lower[k], r.lower[k]);
        all.upper[k] = std::max(all.upper[k], r.upper[k]);
      }
      all.distance_um.merge(r.distance_um);
    }
  }
  if (keep && !options.rows && surface.report.triangles == 0) {
    throw InputError(
        "nothing of the stack prints: the dose reaches 1 nowhere; expected a stack made for this "
        "printer, resin and speed");
  }
  return surface;
}

}  // namespace

double image_row_of(const SliceSource& stack, double x_mm, double y_mm) {
  OnPlate(stack).take_off(x_mm, y_mm);
  const Grid& g = stack.grid();
  return g.height_px - y_mm * 1e3 / g.pixel_y_um;
}

double SolidSize::triangles(int reduce) const {
  return of_areas / (static_cast<double>(reduce) * reduce) + of_walls / reduce;
}

int SolidSize::reduction(double most) const {
  int reduce = 1;
  while (reduce < 64 && triangles(reduce) > most) ++reduce;
  return reduce;
}

SolidSize size_of_solid(const SliceSource& stack, const PlaceModels& models,
                        const ExecutionContext& context) {
  const auto count = [&](int reduce) {
    SolidOptions options;
    options.reduce = reduce;
    const auto r = surface_of(stack, models, options, ".", "counting triangles", false, context);
    return static_cast<double>(r.report.triangles);
  };
  const double at4 = count(4), at8 = count(8);
  // From areas / n² + walls / n at n = 4 and 8; neither is below 0.
  SolidSize size;
  size.of_areas = std::clamp(32 * (at4 - 2 * at8), 0.0, 16 * at4);
  size.of_walls = 4 * at4 - size.of_areas / 4;
  return size;
}

SolidReport write_solid(const SliceSource& stack, const PlaceModels& models,
                        const std::string& path, const SolidOptions& options,
                        const ExecutionContext& context) {
  const detail::MeshFormat format = detail::mesh_format(path);
  const std::size_t slash = path.rfind('/');
  const std::string folder = slash == std::string::npos ? "." : path.substr(0, slash + 1);
  PrintedSurface surface = surface_of(stack, models, options, folder, "surface", true, context);
  detail::write_triangles(path, format, surface.report.triangles, surface.triangles(), context);
  return std::move(surface.report);
}

SolidReport measure_solid(const SliceSource& stack, const PlaceModels& models,
                          const SolidOptions& options, const ExecutionContext& context) {
  return surface_of(stack, models, options, ".", "measuring", false, context).report;
}

TriangleMesh solid_mesh(const SliceSource& stack, const PlaceModels& models,
                        const SolidOptions& options, const ExecutionContext& context) {
  const PrintedSurface surface = surface_of(stack, models, options, ".", "surface", true, context);
  return detail::merge_corners(surface.triangles(), surface.report.triangles);
}

}  // namespace slicecorr
