// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "stack/formats/ctb_file.hpp"

#include <fmt/format.h>

#include "slicecorr/error.hpp"

namespace slicecorr::detail {
namespace {

constexpr std::uint64_t kMostSets = 64, kMostNameBytes = 256;

/// A text elsewhere in the file, of which a block says where.
std::string read_name(const BinaryFile& file, const BinaryBlock& block, std::size_t offset_at,
                      std::size_t size_at, const char* what) {
  const std::uint32_t offset = block.u32(offset_at), size = block.u32(size_at);
  if (size == 0 || offset == 0) return {};
  if (size > kMostNameBytes) {
    block.fail(size_at, fmt::format("says that the {} has {} bytes, expected at most {}", what,
                                    size, kMostNameBytes));
  }
  return BinaryBlock(file, offset, size, what).text(0, size);
}

void read_settings(const BinaryFile& file, CtbFile& ctb, std::vector<NamedSpan>& spans) {
  const auto block = [&](std::uint32_t offset, std::uint64_t bytes, const char* name) {
    if (offset == 0)
      throw InputError(file.path(), name, "is missing: the file says it is at byte 0");
    spans.push_back({offset, bytes, name});
    return BinaryBlock(file, offset, bytes, name);
  };
  if (ctb.fields.machine_name != 0) {
    ctb.machine = read_name(file, ctb.head, ctb.fields.machine_name, ctb.fields.machine_name + 4,
                            "machine's name");
  }
  if (ctb.version < 2 || (ctb.family != CtbFamily::ctb && ctb.family != CtbFamily::photon)) return;
  if (ctb.head.u32(0x54) != 0)
    ctb.print = block(ctb.head.u32(0x54), kCtbPrintBytes, "print settings");
  if (ctb.family == CtbFamily::photon || ctb.head.u32(0x68) == 0) return;
  ctb.slicer = block(ctb.head.u32(0x68), kCtbSlicerBytes, "slicer settings");
  ctb.machine = read_name(file, *ctb.slicer, 0x1c, 0x20, "machine's name");
  if (ctb.version < 4 || ctb.slicer->u32(0x40) == 0) return;
  ctb.v4 = block(ctb.slicer->u32(0x40), kCtb4Bytes, "settings of version 4");
  if (ctb.version < 5 || ctb.v4->u32(0x50) == 0) return;
  ctb.resin = block(ctb.v4->u32(0x50), 0x1c, "resin");
  ctb.resin_name = read_name(file, *ctb.resin, 0x18, 0x14, "resin's name");
}

/// The block before the data of a layer is a copy of its record, and more.
void check_layer_head(const CtbFile& ctb, const BinaryBlock& head, std::size_t record,
                      bool shared) {
  const std::size_t at = record * kCtbRecordBytes;
  const auto same = [&](std::size_t i) { return head.u32(i) == ctb.table.u32(at + i); };
  if (same(0x0c) && same(0x10) && (shared || (same(0) && same(4)))) return;
  head.fail(0, fmt::format("is not the copy of record {} of the layer table", record));
}

void read_layers(const BinaryFile& file, CtbFile& ctb, std::vector<NamedSpan>& spans) {
  const std::uint64_t count = std::uint64_t{ctb.layers} * ctb.sets;
  ctb.table =
      BinaryBlock(file, ctb.head.u32(ctb.fields.table), count * kCtbRecordBytes, "layer table");
  spans.push_back({ctb.table.offset(), ctb.table.size(), "layer table"});
  double last_z_mm = -1;
  std::vector<std::uint64_t> offsets;
  for (std::uint64_t i = 0; i < count; ++i) {
    const std::uint64_t at = i * kCtbRecordBytes;
    const std::uint64_t layer = i % ctb.layers;
    const double z_mm = ctb.table.real(at, "a layer's place", 1e5);
    ctb.table.real(at + 4, "a layer's exposure", 1e6);
    if (layer == 0) last_z_mm = -1;
    if (z_mm < last_z_mm) {
      ctb.table.fail(at, fmt::format("layer {} is at {:g} mm, below the one before it, at {:g} "
                                     "mm{}",
                                     layer, z_mm, last_z_mm,
                                     ctb.sets > 1 ? "; maybe the sets of each layer follow each "
                                                    "other, which printers don't read"
                                                  : ""));
    }
    last_z_mm = z_mm;
    CtbFile::Layer r;
    r.offset = std::uint64_t{ctb.table.u32(at + 0x14)} << 32 | ctb.table.u32(at + 0x0c);
    r.bytes = ctb.table.u32(at + 0x10);
    const std::uint32_t head_bytes = ctb.table.u32(at + 0x18);
    if (ctb.version >= 3 && ctb.family == CtbFamily::ctb && head_bytes != 0) {
      if (head_bytes != kCtbLayerHeadBytes || r.offset < kCtbLayerHeadBytes) {
        ctb.table.fail(at + 0x18,
                       fmt::format("says that {:X}h bytes stand before the layer's data, "
                                   "expected 54h",
                                   head_bytes));
      }
      r.head_bytes = kCtbLayerHeadBytes;
    }
    if (r.bytes == 0) ctb.table.fail(at + 0x10, fmt::format("layer {} has no data", layer));
    ctb.records.push_back(r);
    offsets.push_back(r.offset);
    // A cipher is other for each layer.
    spans.push_back({r.offset - r.head_bytes, r.head_bytes + r.bytes,
                     fmt::format("layer {}", layer),
                     ctb.key == 0 ? Sharing::layers : Sharing::none});
  }
  std::sort(offsets.begin(), offsets.end());
  for (std::uint64_t i = 0; i < count; ++i) {
    const CtbFile::Layer& r = ctb.records[i];
    if (r.head_bytes == 0) continue;
    ctb.heads.emplace_back(file, r.offset - r.head_bytes, r.head_bytes,
                           fmt::format("head of layer {}", i % ctb.layers));
    const auto same = std::equal_range(offsets.begin(), offsets.end(), r.offset);
    check_layer_head(ctb, ctb.heads.back(), i, same.second - same.first > 1);
  }
  if (!ctb.heads.empty() && ctb.heads.size() != count) {
    throw InputError(file.path(), "layer table", "says that some layers have a head and some not");
  }
}

/// Whether the sets of each layer light ever fewer pixels, or ever more, where `record_of` says that
/// they stand.
template <class RecordOf>
bool are_nested(const std::vector<std::uint64_t>& lit, std::size_t layers, std::size_t sets,
                bool ever_fewer, const RecordOf& record_of) {
  for (std::size_t n = 0; n < layers; ++n) {
    for (std::size_t s = 1; s < sets; ++s) {
      const std::uint64_t before = lit[record_of(n, s - 1)], now = lit[record_of(n, s)];
      if (ever_fewer ? now > before : now < before) return false;
    }
  }
  return true;
}

/// Which of a layer's sets is lit most, and whether the table has the sets one after another, as
/// printers read it, and not those of each layer together.
void check_sets(const BinaryFile& file, CtbFile& ctb) {
  if (ctb.sets < 2) return;
  std::vector<std::uint64_t> lit;
  std::vector<std::uint8_t> code;
  for (const CtbFile::Layer& r : ctb.records) {
    file.read_at(r.offset, r.bytes, code, "layer");
    lit.push_back(lit_in_bit_set(code));
  }
  const auto set_by_set = [&](std::size_t n, std::size_t s) { return ctb.record(n, s); };
  const auto layer_by_layer = [&](std::size_t n, std::size_t s) { return n * ctb.sets + s; };
  const auto nested = [&](bool ever_fewer, const auto& record_of) {
    return are_nested(lit, ctb.layers, ctb.sets, ever_fewer, record_of);
  };
  if (nested(true, set_by_set)) return;
  if (nested(false, set_by_set)) {
    ctb.set_order = SetOrder::least_lit_first;
    return;
  }
  if (nested(true, layer_by_layer) || nested(false, layer_by_layer)) {
    ctb.table.fail(0,
                   "the sets of each layer follow each other, which printers do not read: they "
                   "expect all layers of a set, then those of the next");
  }
}

}  // namespace

const CtbFields& ctb_fields(CtbFamily family) {
  static const CtbFields chitubox{.bed_mm = 0x08,
                                  .total_mm = 0x1c,
                                  .layer_mm = 0x20,
                                  .exposure_s = 0x24,
                                  .bottom_exposure_s = 0x28,
                                  .light_off_s = 0x2c,
                                  .bottom_layers = 0x30,
                                  .bottom_layers_again = 0,
                                  .resolution = 0x34,
                                  .large_preview = 0x3c,
                                  .small_preview = 0x48,
                                  .table = 0x40,
                                  .count = 0x44,
                                  .print_time_s = 0x4c,
                                  .projector = 0x50,
                                  .light = 0x60,
                                  .key = 0x64,
                                  .machine_name = 0,
                                  .head_bytes = kCtbHeadBytes};
  static const CtbFields phz{.bed_mm = 0x4c,
                             .total_mm = 0x48,
                             .layer_mm = 0x08,
                             .exposure_s = 0x0c,
                             .bottom_exposure_s = 0x10,
                             .light_off_s = 0x60,
                             .bottom_layers = 0x14,
                             .bottom_layers_again = 0x64,
                             .resolution = 0x18,
                             .large_preview = 0x20,
                             .small_preview = 0x2c,
                             .table = 0x24,
                             .count = 0x28,
                             .print_time_s = 0x30,
                             .projector = 0x34,
                             .light = 0x3c,
                             .key = 0x58,
                             .machine_name = 0x90,
                             .head_bytes = kPhzHeadBytes};
  static const CtbFields fdg{.bed_mm = 0x50,
                             .total_mm = 0x4c,
                             .layer_mm = 0x20,
                             .exposure_s = 0x24,
                             .bottom_exposure_s = 0x28,
                             .light_off_s = 0x80,
                             .bottom_layers = 0x0c,
                             .bottom_layers_again = 0x14,
                             .resolution = 0x18,
                             .large_preview = 0x2c,
                             .small_preview = 0x30,
                             .table = 0x34,
                             .count = 0x08,
                             .print_time_s = 0x38,
                             .projector = 0x10,
                             .light = 0x40,
                             .key = 0x5c,
                             .machine_name = 0x74,
                             .head_bytes = kPhzHeadBytes};
  return family == CtbFamily::phz ? phz : family == CtbFamily::fdg ? fdg : chitubox;
}

std::vector<CtbPreview> read_ctb_previews(const BinaryFile& file, const BinaryBlock& head,
                                          const std::array<std::size_t, 2>& offsets,
                                          std::vector<NamedSpan>& spans) {
  std::vector<CtbPreview> previews;
  for (const std::size_t at : offsets) {
    const std::uint32_t offset = head.u32(at);
    if (offset == 0) continue;
    CtbPreview preview;
    const std::string name = at == offsets[0] ? "large preview" : "small preview";
    preview.head = BinaryBlock(file, offset, 0x20, name);
    const std::uint64_t width = preview.head.u32(0), height = preview.head.u32(4);
    preview.data_offset = preview.head.u32(8);
    preview.data_bytes = preview.head.u32(12);
    if (width > 4096 || height > 4096 || preview.data_bytes > 2 * width * height + 4) {
      preview.head.fail(0,
                        fmt::format("says {} x {} pixels in {} bytes, expected at most 4096 each "
                                    "and two bytes a pixel",
                                    width, height, preview.data_bytes));
    }
    // In some files both previews share one.
    if (!previews.empty() && previews[0].head.offset() == offset) continue;
    spans.push_back({offset, 0x20, name});
    spans.push_back(
        {preview.data_offset, preview.data_bytes, name + "'s pixels", Sharing::previews});
    previews.push_back(std::move(preview));
  }
  return previews;
}

CtbFile read_ctb(const BinaryFile& file, CtbFamily family) {
  CtbFile ctb;
  ctb.family = family;
  ctb.fields = ctb_fields(family);
  const CtbFields& f = ctb.fields;
  const BinaryBlock start(file, 0, 8, "head");
  const std::uint32_t magic = start.u32(0);
  ctb.version = start.u32(4);
  const bool known = magic == kPhotonMagic ? ctb.version == 1 || ctb.version == 2
                     : magic == kCtbMagic  ? ctb.version == 2 || ctb.version == 3
                     : magic == kCtb4Magic ? ctb.version == 4 || ctb.version == 5
                     : magic == kPhzMagic || magic == kFdgMagic ? ctb.version == 2
                                                                : ctb.version == 4;
  if (!known) {
    start.fail(4, fmt::format("is version {} of its format, which is not known", ctb.version));
  }
  const std::uint64_t head_bytes = ctb.version == 1 ? kPhoton1HeadBytes : f.head_bytes;
  ctb.head = BinaryBlock(file, 0, head_bytes, "head");
  const BinaryBlock& head = ctb.head;
  ctb.width_px = head.u32(f.resolution);
  ctb.height_px = head.u32(f.resolution + 4);
  ctb.layers = head.u32(f.count);
  check_image_size(file, ctb.width_px, ctb.height_px);
  check_layer_count(file, ctb.layers);
  if (ctb.version >= 2) ctb.key = head.u32(f.key);
  if (ctb.version >= 2 && family == CtbFamily::photon) {
    ctb.sets = head.u32(0x5c);
    if (ctb.sets < 1 || ctb.sets > kMostSets) {
      head.fail(0x5c, fmt::format("says {} sets of images, expected 1 to {}", ctb.sets, kMostSets));
    }
  }
  if (family == CtbFamily::photon && ctb.key != 0) {
    head.fail(f.key, "says that layers are ciphered, which is not known of this format");
  }
  std::vector<NamedSpan> spans{{0, head_bytes, "head"}};
  ctb.previews = read_ctb_previews(file, head, {f.large_preview, f.small_preview}, spans);
  read_settings(file, ctb, spans);
  read_layers(file, ctb, spans);
  check_spans(file, std::move(spans));
  check_sets(file, ctb);
  return ctb;
}

namespace {
/// Of a preview's words: more of the same follow, as many as the next word says beside its mark.
constexpr std::uint16_t kPreviewRepeated = 0x20;
constexpr std::size_t kPreviewMostMore = 0xfff;
}  // namespace

GreyImage decode_ctb_preview(const BinaryFile& file, const CtbPreview& preview) {
  const BinaryBlock code(file, preview.data_offset, preview.data_bytes, "preview's pixels");
  GreyImage image{static_cast<int>(preview.head.u32(0)), static_cast<int>(preview.head.u32(4)), {}};
  const std::size_t all =
      static_cast<std::size_t>(image.width_px) * static_cast<std::size_t>(image.height_px);
  for (std::size_t at = 0; at + 2 <= code.size() && image.pixels.size() < all; at += 2) {
    const std::uint16_t word = code.u16(at);
    std::size_t n = 1;
    if ((word & kPreviewRepeated) != 0 && at + 4 <= code.size()) {
      at += 2;
      n += code.u16(at) & kPreviewMostMore;
    }
    const std::uint8_t grey = grey_of_rgb565(word & ~std::uint32_t{kPreviewRepeated});
    image.pixels.resize(std::min(all, image.pixels.size() + n), grey);
  }
  image.pixels.resize(all, 0);
  return image;
}

std::vector<std::uint8_t> encode_ctb_preview(const GreyImage& preview, int width_px,
                                             int height_px) {
  std::vector<std::uint8_t> out;
  const auto put = [&](unsigned word) {
    out.push_back(static_cast<std::uint8_t>(word));
    out.push_back(static_cast<std::uint8_t>(word >> 8));
  };
  const std::vector<std::uint16_t> words = rgb565_preview(preview, width_px, height_px);
  for (std::size_t i = 0; i < words.size();) {
    std::size_t n = 1;
    while (i + n < words.size() && words[i + n] == words[i] && n <= kPreviewMostMore) ++n;
    const unsigned word = words[i] & ~unsigned{kPreviewRepeated};
    if (n == 1) {
      put(word);
    } else {
      put(word | kPreviewRepeated);
      put(0x3000 | static_cast<unsigned>(n - 1));
    }
    i += n;
  }
  return out;
}

}  // namespace slicecorr::detail
