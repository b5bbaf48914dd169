// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Changed and new files of CTB's family.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>

#include "slicecorr/error.hpp"
#include "stack/formats/ctb_file.hpp"
#include "stack/formats/format_times.hpp"

namespace slicecorr::detail {
namespace {

/// One change of a file: the spans that become others, then their contents.
class CtbChange {
 public:
  CtbChange(const ArchiveRequest& request, CtbFamily family)
      : r_(request),
        file_(binary_file(*request.kept)),
        ctb_(read_ctb(file_, family)),
        layers_(static_cast<std::size_t>(request.info.grid.layers)),
        change_(file_) {}

  void run(BinaryOutput& output) {
    place_layers();
    const std::size_t table = change_.replace(ctb_.table.offset(), ctb_.table.size(),
                                              layers_ * ctb_.sets * kCtbRecordBytes);
    std::vector<std::pair<std::size_t, BinaryBlock*>> blocks;
    const auto keep = [&](BinaryBlock& block) {
      blocks.emplace_back(change_.replace(block.offset(), block.size(), block.size()), &block);
    };
    keep(ctb_.head);
    for (CtbPreview& preview : ctb_.previews) keep(preview.head);
    for (auto* block : {&ctb_.print, &ctb_.slicer, &ctb_.v4, &ctb_.resin}) {
      if (*block) keep(**block);
    }
    change_.lay_out();
    change_settings();
    move_offsets();
    change_.fill(table, make_table());
    fill_layers();
    for (auto& [span, block] : blocks) change_.fill(span, block->bytes());
    change_.add_to(output);
  }

 private:
  std::size_t piece_of(std::size_t layer, std::size_t set) const { return layer * ctb_.sets + set; }
  std::uint64_t size_of(std::size_t piece) const { return r_.layers->sizes[piece]; }
  std::uint64_t head_bytes() const { return ctb_.heads.empty() ? 0 : kCtbLayerHeadBytes; }

  /// Height of layers that are added: that of the last one.
  double last_mm() const {
    const StackInfo& old = r_.kept_contents->info;
    if (old.layer_heights_um.empty()) return ctb_.head.f32(ctb_.fields.layer_mm);
    return layer_height_um(old, old.grid.layers) * 1e-3;
  }

  /// A span for each piece.
  void place_layers() {
    pieces_.resize(layers_ * ctb_.sets);
    const std::size_t old_layers = ctb_.layers;
    std::map<std::uint64_t, SharedBytes> kept;  // by the place of their data
    std::uint64_t end = 0;
    for (std::size_t n = 0; n < old_layers; ++n) {
      for (std::size_t s = 0; s < ctb_.sets; ++s) {
        const CtbFile::Layer& old = ctb_.records[ctb_.record(n, s)];
        SharedBytes& bytes = kept[old.offset];
        bytes.at = old.offset - old.head_bytes;
        bytes.size = old.head_bytes + old.bytes;
        if (n < layers_) bytes.pieces.push_back(piece_of(n, s));
        end = std::max(end, old.offset + old.bytes);
      }
    }
    std::vector<SharedBytes> all;
    all.reserve(kept.size());
    for (auto& [at, bytes] : kept) all.push_back(std::move(bytes));
    replace_shared(change_, *r_.layers, head_bytes(), all, pieces_);
    for (std::size_t n = old_layers; n < layers_; ++n) {
      for (std::size_t s = 0; s < ctb_.sets; ++s) {
        pieces_[piece_of(n, s)].span =
            change_.replace(end, 0, head_bytes() + size_of(piece_of(n, s)));
      }
    }
  }

  /// Layer count, sizes and times, where they change.
  void change_settings() {
    BinaryBlock& head = ctb_.head;
    const CtbFields& f = ctb_.fields;
    const StackInfo& info = r_.info;
    const auto added =
        static_cast<std::ptrdiff_t>(layers_) - static_cast<std::ptrdiff_t>(ctb_.layers);
    if (added != 0) {
      head.set_u32(f.count, static_cast<std::uint32_t>(layers_));
      head.set_f32(f.total_mm, head.f32(f.total_mm) + static_cast<double>(added) * last_mm());
      if (ctb_.v4) ctb_.v4->set_u32(0x34, static_cast<std::uint32_t>(layers_ - 1));
    }
    head.set_u32(f.print_time_s,
                 changed_print_time_s(head.u32(f.print_time_s), r_.kept_contents->info, info));
    if (r_.light_changes) change_light();
    if (!r_.exposure_changes) return;
    const ExposureSummary s = head_summary(info);
    const bool says_fade = ctb_.slicer.has_value() && ctb_.version >= 4;
    if (!ctb_.has_layer_flag()) {
      require_even_times(r_, s,
                         "the file's mark that printers heed times of single layers is not set");
      if (s.fade_layers > 0 && !says_fade) {
        throw InputError(file_.path(), "",
                         "can't say that exposures fade from bottom layers to the others; expected "
                         "no fade layers");
      }
    }
    head.set_f32(f.exposure_s, s.normal_s);
    head.set_f32(f.bottom_exposure_s, s.bottom_s);
    if (s.uneven && s.bottom_layers == 0) return;
    head.set_u32(f.bottom_layers, static_cast<std::uint32_t>(s.bottom_layers));
    if (f.bottom_layers_again != 0) {
      head.set_u32(f.bottom_layers_again, static_cast<std::uint32_t>(s.bottom_layers));
    }
    if (ctb_.print) ctb_.print->set_u32(0x28, static_cast<std::uint32_t>(s.bottom_layers));
    if (says_fade) ctb_.slicer->set_u32(0x3c, static_cast<std::uint32_t>(s.fade_layers));
  }

  void change_light() {
    if (ctb_.version < 2) {
      throw InputError(
          file_.path(), "",
          "is of a version that can't say light below full; expected all of the light");
    }
    BinaryBlock& head = ctb_.head;
    const LightSteps steps =
        light_steps(r_, file_.path(), static_cast<int>(head.u32(ctb_.fields.bottom_layers)));
    if (!ctb_.has_layer_flag() && steps.uneven) {
      throw InputError(
          file_.path(), "",
          "the file's mark that printers heed settings of single layers is not set, so "
          "layers can't have light of their own; expected one share for the bottom layers "
          "and one for all others");
    }
    light_ = steps.layers;
    head.set_u16(ctb_.fields.light, steps.usual);
    head.set_u16(ctb_.fields.light + 2, steps.bottom);
  }

  void move_offset(BinaryBlock& block, std::size_t at) const {
    if (block.u32(at) != 0)
      block.set_u32(at, static_cast<std::uint32_t>(change_.moved(block.u32(at))));
  }
  void move_offsets() {
    BinaryBlock& head = ctb_.head;
    const CtbFields& f = ctb_.fields;
    for (const std::size_t at : {f.large_preview, f.table, f.small_preview}) move_offset(head, at);
    if (f.machine_name != 0) move_offset(head, f.machine_name);
    for (CtbPreview& preview : ctb_.previews) move_offset(preview.head, 8);
    if (ctb_.print) move_offset(head, 0x54);
    if (ctb_.slicer) {
      move_offset(head, 0x68);
      move_offset(*ctb_.slicer, 0x1c);
    }
    if (ctb_.v4) {
      move_offset(*ctb_.slicer, 0x40);
      move_offset(*ctb_.v4, 0x48);
    }
    if (ctb_.resin) {
      move_offset(*ctb_.v4, 0x50);
      // Its type, its name and the machine's.
      for (const std::size_t at : {0x10, 0x18, 0x08}) move_offset(*ctb_.resin, at);
    }
  }

  /// The record of a piece, from that of the old layer or, of one that is added, the last one.
  BinaryBlock record(std::size_t layer, std::size_t set) const {
    const std::size_t old = std::min<std::size_t>(layer, ctb_.layers - 1);
    const std::size_t at = ctb_.record(old, set) * kCtbRecordBytes;
    BinaryBlock record(kCtbRecordBytes, ByteOrder::little);
    std::copy_n(ctb_.table.bytes().begin() + static_cast<std::ptrdiff_t>(at), kCtbRecordBytes,
                record.bytes().begin());
    if (layer != old) {
      record.set_f32(0, record.f32(0) + static_cast<double>(layer - old) * last_mm());
    }
    if (r_.exposure_changes) record.set_f32(4, light_on_of_layer(r_.info, static_cast<int>(layer)));
    const std::size_t piece = piece_of(layer, set);
    const std::uint64_t offset = change_.place(pieces_[piece].span) + head_bytes();
    record.set_u32(0x0c, static_cast<std::uint32_t>(offset));
    record.set_u32(0x10, static_cast<std::uint32_t>(size_of(piece)));
    record.set_u32(0x14, static_cast<std::uint32_t>(offset >> 32));
    return record;
  }

  std::vector<std::uint8_t> make_table() const {
    std::vector<std::uint8_t> table;
    table.reserve(layers_ * ctb_.sets * kCtbRecordBytes);
    for (std::size_t s = 0; s < ctb_.sets; ++s) {
      for (std::size_t n = 0; n < layers_; ++n) {
        const BinaryBlock its = record(n, s);
        table.insert(table.end(), its.bytes().begin(), its.bytes().end());
      }
    }
    return table;
  }

  /// What stands before a piece's data: of the copy of its record changes only what does in the
  /// record. Place and exposure are those of one of the layers that share it; `alone`: of its own.
  std::vector<std::uint8_t> layer_head(std::size_t layer, std::size_t set, bool alone) const {
    const std::size_t old = ctb_.record(std::min<std::size_t>(layer, ctb_.layers - 1), set);
    BinaryBlock head = ctb_.heads[old];
    const BinaryBlock its = record(layer, set);
    for (std::size_t at = 0; at < kCtbRecordBytes; at += 4) {
      const bool changes = its.u32(at) != ctb_.table.u32(old * kCtbRecordBytes + at);
      if (changes || (alone && at < 8)) head.set_u32(at, its.u32(at));
    }
    const std::uint64_t bytes = size_of(piece_of(layer, set));
    if (!light_.empty()) head.set_f32(0x50, light_[layer]);
    if (bytes != ctb_.records[old].bytes) {
      head.set_u32(0x24, static_cast<std::uint32_t>(kCtbLayerHeadBytes + bytes));
    }
    return std::move(head.bytes());
  }

  void fill_layers() {
    const CodedLayers* const layers = r_.layers;
    std::map<std::size_t, int> users;  // of spans
    for (const PieceSpan& piece : pieces_) ++users[piece.span];
    for (std::size_t n = 0; n < layers_; ++n) {
      for (std::size_t s = 0; s < ctb_.sets; ++s) {
        const std::size_t piece = piece_of(n, s);
        if (!pieces_[piece].owns) continue;
        std::vector<std::uint8_t> head;
        if (!ctb_.heads.empty()) head = layer_head(n, s, users[pieces_[piece].span] == 1);
        change_.fill(
            pieces_[piece].span,
            [layers, head = std::move(head)](std::size_t p, std::vector<std::uint8_t>& out) {
              out = head;
              layers->append(p, out);
            },
            piece);
      }
    }
  }

  const ArchiveRequest& r_;
  const BinaryFile& file_;
  CtbFile ctb_;
  const std::size_t layers_;
  FileChange change_;
  std::vector<PieceSpan> pieces_;
  std::vector<unsigned> light_;  ///< of each layer, where it changes
};

}  // namespace

void change_ctb(const ArchiveRequest& request, CtbFamily family, BinaryOutput& output) {
  CtbChange(request, family).run(output);
}

/// Version 4, without a cipher: head, previews, settings, layer table, layers.
void write_new_ctb(const ArchiveRequest& r, BinaryOutput& output) {
  const StackInfo& info = r.info;
  const Grid& grid = info.grid;
  const ExposureSummary s = head_summary(info);
  const auto layers = static_cast<std::size_t>(grid.layers);
  const NewLift lift = new_lift(info);
  tell_new_lift(r, "CTB", lift);
  const std::string machine = info.printer ? info.printer->name : info.profiles.printer;
  const auto large = encode_ctb_preview(r.preview, 400, 300);
  const auto small = encode_ctb_preview(r.preview, 200, 125);
  const auto little = ByteOrder::little;
  BinaryBlock head(kCtbHeadBytes, little), large_head(0x20, little), small_head(0x20, little);
  BinaryBlock print(kCtbPrintBytes, little), slicer(kCtbSlicerBytes, little),
      v4(kCtb4Bytes, little);
  const std::size_t large_at = head.size(), small_at = large_at + 0x20 + large.size();
  const std::size_t print_at = small_at + 0x20 + small.size();
  const std::size_t slicer_at = print_at + print.size(), name_at = slicer_at + slicer.size();
  const std::size_t v4_at = name_at + machine.size(), table_at = v4_at + v4.size();
  const double total_mm = stack_height_um(info, grid.layers) * 1e-3;
  const bool own_heights = has_own_heights(info);
  const LightSteps light = light_steps(r, r.stem, s.bottom_layers);
  const bool own = s.uneven || light.uneven || lift.differs_from_head(s.bottom_layers, false);
  if (own) tell_own_settings(r, "CTB");
  std::vector<double> times_s = layer_times(info);
  double print_time_s = 0;
  for (std::size_t n = 0; n < layers; ++n) {
    print_time_s += times_s[n] + lift.dark_s(static_cast<int>(n));
  }
  const LiftMotion &normal = lift.times.of(grid.layers - 1), &bottom = lift.times.of(0);

  head.set_u32(0, kCtb4Magic);
  head.set_u32(4, 4);
  head.set_f32(0x08, grid.width_px * grid.pixel_x_um * 1e-3);
  head.set_f32(0x0c, grid.height_px * grid.pixel_y_um * 1e-3);
  head.set_f32(0x10, new_machine_height_mm(info, total_mm));
  head.set_f32(0x1c, total_mm);
  head.set_f32(0x20, grid.layer_um * 1e-3);
  head.set_f32(0x24, s.normal_s);
  head.set_f32(0x28, s.bottom_s);
  head.set_f32(0x2c, normal.light_off_s);
  head.set_u32(0x30, static_cast<std::uint32_t>(s.bottom_layers));
  head.set_u32(0x34, static_cast<std::uint32_t>(grid.width_px));
  head.set_u32(0x38, static_cast<std::uint32_t>(grid.height_px));
  head.set_u32(0x3c, static_cast<std::uint32_t>(large_at));
  head.set_u32(0x40, static_cast<std::uint32_t>(table_at));
  head.set_u32(0x44, static_cast<std::uint32_t>(layers));
  head.set_u32(0x48, static_cast<std::uint32_t>(small_at));
  head.set_u32(0x4c, static_cast<std::uint32_t>(std::min(print_time_s, 4e9)));
  head.set_u32(0x50, info.orientation.mirror_x ? 1 : 0);
  head.set_u32(0x54, static_cast<std::uint32_t>(print_at));
  head.set_u32(0x58, static_cast<std::uint32_t>(print.size()));
  head.set_u32(0x5c, 1);
  head.set_u16(0x60, light.usual);
  head.set_u16(0x62, light.bottom);
  head.set_u32(0x68, static_cast<std::uint32_t>(slicer_at));
  head.set_u32(0x6c, static_cast<std::uint32_t>(slicer.size()));

  const auto preview_head = [](BinaryBlock& block, std::uint32_t w, std::uint32_t h, std::size_t at,
                               std::size_t bytes) {
    block.set_u32(0, w);
    block.set_u32(4, h);
    block.set_u32(8, static_cast<std::uint32_t>(at + 0x20));
    block.set_u32(12, static_cast<std::uint32_t>(bytes));
  };
  preview_head(large_head, 400, 300, large_at, large.size());
  preview_head(small_head, 200, 125, small_at, small.size());

  // Ways up are told as a whole, and the second stage beside them.
  const auto set_up = [](BinaryBlock& block, std::size_t at, const LiftMotion& m) {
    block.set_f32(at, m.up_mm + m.up_2_mm);
    block.set_f32(at + 4, 60 * m.up_mm_s);
  };
  const auto set_pair = [](BinaryBlock& block, std::size_t at, double way_mm, double mm_s) {
    block.set_f32(at, way_mm);
    block.set_f32(at + 4, 60 * mm_s);
  };
  set_up(print, 0x00, bottom);
  set_up(print, 0x08, normal);
  print.set_f32(0x10, 60 * normal.back_mm_s);
  print.set_f32(0x20, bottom.light_off_s);
  print.set_f32(0x24, normal.light_off_s);
  print.set_f32(0x14, info.part_volume_mm3 * 1e-3);
  print.set_u32(0x28, static_cast<std::uint32_t>(s.bottom_layers));

  slicer.set_u32(0x1c, static_cast<std::uint32_t>(name_at));
  slicer.set_u32(0x20, static_cast<std::uint32_t>(machine.size()));
  slicer.set_u8(0x24, 0x0f);
  slicer.set_u8(0x27, own ? 0x40 : 0);
  slicer.set_u32(0x2c, 8);
  set_pair(slicer, 0x00, bottom.up_2_mm, bottom.up_2_mm_s);
  set_pair(slicer, 0x08, normal.up_2_mm, normal.up_2_mm_s);
  set_pair(slicer, 0x10, normal.back_2_mm, normal.back_2_mm_s);
  for (const std::size_t at : {0x18, 0x38}) slicer.set_f32(at, normal.after_lift_s);
  slicer.set_f32(0x34, normal.before_light_s);
  slicer.set_u32(0x3c, static_cast<std::uint32_t>(s.fade_layers));
  slicer.set_u32(0x40, static_cast<std::uint32_t>(v4_at));
  v4.set_f32(0, 60 * bottom.back_mm_s);
  v4.set_f32(0x04, 60 * bottom.back_2_mm_s);
  v4.set_f32(0x18, normal.before_light_s);
  v4.set_f32(0x1c, normal.after_lift_s);
  v4.set_f32(0x20, normal.before_lift_s);
  v4.set_f32(0x24, bottom.back_2_mm);
  v4.set_f32(0x0c, 4);
  v4.set_f32(0x14, 4);
  v4.set_u32(0x34, static_cast<std::uint32_t>(layers - 1));

  std::vector<std::uint8_t> table;
  std::vector<BinaryBlock> heads;
  std::uint64_t at = table_at + layers * kCtbRecordBytes;
  double z_um = 0;
  for (std::size_t n = 0; n < layers; ++n) {
    const std::uint64_t bytes = r.layers->sizes[n], offset = at + kCtbLayerHeadBytes;
    BinaryBlock block(kCtbLayerHeadBytes, little);
    z_um = own_heights ? z_um + layer_height_um(info, static_cast<int>(n))
                       : static_cast<double>(n + 1) * grid.layer_um;
    block.set_f32(0, z_um * 1e-3);
    block.set_f32(4, times_s[n]);
    const LiftMotion& m = lift.times.of(static_cast<int>(n));
    block.set_f32(8, m.light_off_s);
    block.set_u32(0x0c, static_cast<std::uint32_t>(offset));
    block.set_u32(0x10, static_cast<std::uint32_t>(bytes));
    block.set_u32(0x14, static_cast<std::uint32_t>(offset >> 32));
    block.set_u32(0x18, kCtbLayerHeadBytes);
    table.insert(table.end(), block.bytes().begin(), block.bytes().begin() + kCtbRecordBytes);
    block.set_u32(0x24, static_cast<std::uint32_t>(kCtbLayerHeadBytes + bytes));
    set_up(block, 0x28, m);
    set_pair(block, 0x30, m.up_2_mm, m.up_2_mm_s);
    block.set_f32(0x38, 60 * m.back_mm_s);
    set_pair(block, 0x3c, m.back_2_mm, m.back_2_mm_s);
    block.set_f32(0x44, m.before_lift_s);
    block.set_f32(0x48, m.after_lift_s);
    block.set_f32(0x4c, m.before_light_s);
    block.set_f32(0x50, light.layers[n]);
    at = offset + bytes;
    heads.push_back(std::move(block));
  }
  output.add_piece(head.bytes());
  output.add_piece(large_head.bytes());
  output.add_piece(large);
  output.add_piece(small_head.bytes());
  output.add_piece(small);
  output.add_piece(print.bytes());
  output.add_piece(slicer.bytes());
  output.add_piece({machine.begin(), machine.end()});
  output.add_piece(v4.bytes());
  output.add_piece(table);
  const CodedLayers* const coded = r.layers;
  for (std::size_t n = 0; n < layers; ++n) {
    output.add_piece(
        kCtbLayerHeadBytes + coded->sizes[n],
        [coded, head_of = std::move(heads[n].bytes())](std::size_t i, auto& out) {
          out = head_of;
          coded->append(i, out);
        },
        n);
  }
}

}  // namespace slicecorr::detail
