// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <memory>
#include <stdexcept>

#include "base/run_length.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/stack.hpp"
#include "stack/formats/exposure_pattern.hpp"
#include "stack/formats/uvj_config.hpp"
#include "stack/png/png.hpp"
#include "stack/stack_reader_parts.hpp"

namespace slicecorr {

using detail::ArchiveContents;
using detail::Container;

namespace {

constexpr std::size_t kReaderMemory = std::size_t{32} << 20;

std::vector<std::string> others_of(const Container& archive, const ArchiveContents& contents) {
  std::vector<std::string> images = contents.images, others;
  images.insert(images.end(), contents.uv_images.begin(), contents.uv_images.end());
  images.insert(images.end(), contents.edge_images.begin(), contents.edge_images.end());
  std::sort(images.begin(), images.end());
  for (const Container::Entry& entry : archive.entries()) {
    if (!std::binary_search(images.begin(), images.end(), entry.name)) others.push_back(entry.name);
  }
  return others;
}

void take_missing(StackInfo& info, const MissingFacts& missing, const std::string& path) {
  Grid& grid = info.grid;
  const auto take = [&](double& size_um, double given_um, const char* what) {
    if (size_um > 0) return;
    if (!(given_um > 0)) {
      throw InputError(path, "", std::string("does not say how ") + what);
    }
    size_um = given_um;
  };
  take(grid.pixel_x_um, missing.pixel_x_um, "large its pixels are; expected a printer that does");
  take(grid.pixel_y_um, missing.pixel_y_um, "large its pixels are; expected a printer that does");
  take(grid.layer_um, missing.layer_um,
       "high its layers are; expected the layer height to be given");
}

}  // namespace

/// The edge heights of the stack that it belongs to.
class StackReader::EdgeHeights final : public SliceSource {
 public:
  explicit EdgeHeights(const Impl& stack) : stack_(stack), grid_(stack.config.info.grid) {
    ++grid_.layers;
  }
  const Grid& grid() const override { return grid_; }
  PixelBox bounds() const override { return stack_.edge_index.lit; }
  ImageFrame frame() const override { return image_frame(stack_.config.info); }
  void read_band(const PixelBox& band, const Sink& sink) const override {
    stack_.read_band(stack_.edge_index, band, sink);
  }

 private:
  const Impl& stack_;
  Grid grid_;
};

StackReader::Impl::Impl(const std::string& p, const std::string& folder,
                        const ExecutionContext& context)
    : path(p), store(folder, kReaderMemory, context) {}
StackReader::Impl::~Impl() = default;

/// Copies what the blob of `band` has of `box` to `out`, which holds the rows of `box`.
void StackReader::Impl::copy_blob(const BlobStore::Blob& blob, const PixelBox& band,
                                  const PixelBox& box, std::vector<std::uint8_t>& code,
                                  std::vector<std::uint8_t>& pixels, std::uint8_t* out) const {
  code.clear();
  store.get(blob, code);
  std::int32_t columns[2];
  std::memcpy(columns, code.data(), sizeof columns);
  const auto stride = static_cast<std::size_t>(columns[1] - columns[0]);
  pixels.resize(stride * static_cast<std::size_t>(band.height()));
  detail::run_length_decode(code.data() + sizeof columns, code.data() + code.size(), pixels.data(),
                            pixels.size());
  const int x0 = std::max(columns[0], box.x0), x1 = std::min(columns[1], box.x1);
  if (x0 >= x1) return;
  for (int y = std::max(band.y0, box.y0); y < std::min(band.y1, box.y1); ++y) {
    std::memcpy(out + static_cast<std::size_t>(y - box.y0) * static_cast<std::size_t>(box.width()) +
                    (x0 - box.x0),
                pixels.data() + static_cast<std::size_t>(y - band.y0) * stride + (x0 - columns[0]),
                static_cast<std::size_t>(x1 - x0));
  }
}

StackReader::StackReader(const std::string& path, const std::string& scratch_folder,
                         const ExecutionContext& context, const MissingFacts& missing)
    : impl_(std::make_unique<Impl>(path, scratch_folder, context)) {
  Impl& s = *impl_;
  const std::unique_ptr<Container> archive = detail::open_container(path, scratch_folder, context);
  s.config = detail::read_contents(*archive);
  take_missing(s.config.info, missing, path);
  s.others = others_of(*archive, s.config);
  const std::vector<std::uint32_t> adlers = s.decode_images(*archive, context);
  s.images_changed =
      s.config.images_crc32 && *s.config.images_crc32 != detail::images_crc32(adlers);
  if (s.images_changed) context.tell(path + ": images were changed after the stack was made");
  if (!s.config.uv_images.empty()) {
    s.uv_images_changed = s.config.uv_images_crc32 !=
                          detail::images_crc32(s.decode_grey(s.uv_index, s.config.uv_images,
                                                             *archive, "read UV", context));
    if (s.uv_images_changed) {
      context.tell(path + ": UV images were changed after the stack was made");
    }
  }
  if (!s.config.edge_images.empty()) {
    s.edge_heights_changed = s.config.edge_images_crc32 !=
                             detail::images_crc32(s.decode_grey(s.edge_index, s.config.edge_images,
                                                                *archive, "read edges", context));
    if (s.edge_heights_changed) {
      context.tell(path + ": edge heights were changed after the stack was made");
    }
    s.edge_heights = std::make_unique<const EdgeHeights>(s);
  }
}

StackReader::~StackReader() = default;

const StackInfo& StackReader::info() const { return impl_->config.info; }
const Grid& StackReader::grid() const { return impl_->config.info.grid; }
PixelBox StackReader::bounds() const { return impl_->index.lit; }
const Recording* StackReader::recording() const { return impl_->config.info.recording.get(); }
ImageFrame StackReader::frame() const { return image_frame(impl_->config.info); }
ImageFrame image_frame(const StackInfo& info) {
  ImageFrame frame;
  if (info.for_display) frame.to_display = Turn{};
  frame.orientation.reset();
  if (info.orientation_known) frame.orientation = info.orientation;
  frame.made_for = info.made_for;
  return frame;
}
const std::vector<std::string>& StackReader::other_entries() const { return impl_->others; }
std::uint64_t StackReader::pixel_sum() const { return impl_->sum; }
bool StackReader::has_uv_images() const { return !impl_->config.uv_images.empty(); }
bool StackReader::has_checksums() const { return impl_->config.images_crc32.has_value(); }
bool StackReader::images_changed() const { return impl_->images_changed; }
bool StackReader::uv_images_changed() const { return impl_->uv_images_changed; }
const SliceSource* StackReader::edge_heights() const { return impl_->edge_heights.get(); }
bool StackReader::edge_heights_changed() const { return impl_->edge_heights_changed; }

void StackReader::Impl::read_image(const Index& of, int slice, std::uint8_t* out) const {
  const Grid& grid = config.info.grid;
  if (slice < 0 || slice >= grid.layers) throw std::out_of_range("no such slice");
  const PixelBox all{0, 0, grid.width_px, grid.height_px};
  std::fill_n(out, static_cast<std::size_t>(grid.width_px) * static_cast<unsigned>(grid.height_px),
              std::uint8_t{0});
  std::vector<std::uint8_t> code, pixels;
  for (int band = 0; band < bands; ++band) {
    const BlobStore::Blob& its = blob(of, band, slice);
    if (its.size == 0) continue;
    const int y0 = band * rows;
    copy_blob(its, {0, y0, grid.width_px, std::min(grid.height_px, y0 + rows)}, all, code, pixels,
              out);
  }
}

/// All images of layers that are exposed more than once, as what was shown of each layer.
class StackReader::Exposures final : public SliceSource {
 public:
  Exposures(const Impl& stack, double m) : stack_(stack), grid_(stack.config.info.grid) {
    const StackInfo& info = stack.config.info;
    grid_.layers = static_cast<int>(info.exposures.size());
    std::vector<Recording::Showing> shown;
    for (std::size_t k = 0; k < info.exposures.size(); ++k) {
      const LayerExposure& e = info.exposures[k];
      const SliceLight layer = detail::light_of_layer(info, e.layer);
      const double planned = layer.time_s * std::pow(layer.share, m);
      Recording::Showing showing;
      showing.image = static_cast<int>(k);
      showing.light = planned > 0 ? e.time_s * std::pow(e.light_share, m) / planned : 0;
      showing.blue_share = e.light_share;
      shown.push_back(showing);
      if (k + 1 < info.exposures.size() && info.exposures[k + 1].layer == e.layer) continue;
      recording_.add_slice(shown);
      shown.clear();
    }
  }
  const Grid& grid() const override { return grid_; }
  PixelBox bounds() const override { return stack_.exposure_index.lit; }
  ImageFrame frame() const override { return image_frame(stack_.config.info); }
  const Recording* recording() const override { return &recording_; }
  LayerHeights heights() const override {
    return LayerHeights(process_of_times(stack_.config.info).layer_heights_um);
  }
  void read_band(const PixelBox& band, const Sink& sink) const override {
    stack_.read_band(stack_.exposure_index, band, sink);
  }

 private:
  const Impl& stack_;
  Grid grid_;
  Recording recording_;
};

std::unique_ptr<const SliceSource> StackReader::exposures(double m) const {
  if (impl_->config.info.exposures.empty()) return nullptr;
  return std::make_unique<const Exposures>(*impl_, m);
}

LayerHeights StackReader::heights() const {
  return LayerHeights(process_of_times(impl_->config.info).layer_heights_um);
}

int StackReader::several_images_layer() const { return impl_->several_layer; }

void StackReader::read_slice(int slice, std::uint8_t* pixels) const {
  impl_->read_image(impl_->index, slice, pixels);
}

void StackReader::read_uv_slice(int slice, std::uint8_t* pixels) const {
  if (!has_uv_images()) throw std::logic_error("the stack has no UV images");
  impl_->read_image(impl_->uv_index, slice, pixels);
}

void StackReader::read_band(const PixelBox& band, const Sink& sink) const {
  if (impl_->several_layer >= 0) {
    throw InputError(
        impl_->path, fmt::format("layer {}", impl_->several_layer),
        "is exposed more than once, with images or light that differ, as in a test of exposures: what it "
        "prints is predicted (verify and probe with an own target), but it is no part to be corrected or "
        "converted");
  }
  impl_->read_band(impl_->index, band, sink);
}

void StackReader::Impl::read_band(const Index& of, const PixelBox& box, const Sink& sink) const {
  const Grid& grid = config.info.grid;
  if (box.x0 < 0 || box.y0 < 0 || box.x1 > grid.width_px || box.y1 > grid.height_px) {
    throw std::out_of_range("band reaches over the image");
  }
  const int first = box.empty() ? 0 : box.y0 / rows;
  const int last = box.empty() ? 0 : (box.y1 + rows - 1) / rows;
  std::vector<std::uint8_t> code, pixels;
  std::vector<std::uint8_t> out(static_cast<std::size_t>(box.width()) *
                                static_cast<std::size_t>(box.height()));
  for (int slice = 0; slice < of.images; ++slice) {
    bool lit = false;
    for (int band = first; band < last; ++band) {
      const BlobStore::Blob& blob = this->blob(of, band, slice);
      if (blob.size == 0) continue;
      if (!lit) std::fill(out.begin(), out.end(), std::uint8_t{0});
      lit = true;
      const int y0 = band * rows;
      const PixelBox its_rows{0, y0, grid.width_px, std::min(grid.height_px, y0 + rows)};
      copy_blob(blob, its_rows, box, code, pixels, out.data());
    }
    sink(slice, lit ? out.data() : nullptr);
  }
}

}  // namespace slicecorr
