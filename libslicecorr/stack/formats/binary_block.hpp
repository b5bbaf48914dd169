// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file binary_block.hpp
/// Parts of binary print files: numbers at offsets, and files that are changed span by span.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "stack/container/binary_file.hpp"
#include "stack/formats/archive_format.hpp"

namespace slicecorr::detail {

enum class ByteOrder { little, big };

/// A part of a file in memory. Its numbers are read and written at offsets from its start.
class BinaryBlock {
 public:
  BinaryBlock() = default;
  /// Of a file; throws `InputError` naming the block where the file ends before it does.
  BinaryBlock(const BinaryFile& file, std::uint64_t offset, std::uint64_t size, std::string name,
              ByteOrder order = ByteOrder::little);
  /// A new one, all zero.
  BinaryBlock(std::size_t size, ByteOrder order) : order_(order), bytes_(size) {}

  std::uint8_t u8(std::size_t at) const { return bytes_.at(at); }
  std::uint16_t u16(std::size_t at) const { return static_cast<std::uint16_t>(number(at, 2)); }
  std::uint32_t u32(std::size_t at) const { return number(at, 4); }
  /// A number that must be finite and from 0 to `most`; throws `InputError` naming it otherwise.
  double real(std::size_t at, const char* what, double most) const;
  /// The same number whatever it is.
  float f32(std::size_t at) const;
  std::string text(std::size_t at, std::size_t most_bytes) const;

  void set_u8(std::size_t at, std::uint8_t value) { bytes_.at(at) = value; }
  void set_u16(std::size_t at, std::uint32_t value) { set_number(at, value, 2); }
  void set_u32(std::size_t at, std::uint32_t value) { set_number(at, value, 4); }
  void set_f32(std::size_t at, double value);
  void set_text(std::size_t at, std::size_t most_bytes, const std::string& text);
  void set_bytes(std::size_t at, std::string_view bytes);

  std::uint64_t offset() const { return offset_; }
  std::size_t size() const { return bytes_.size(); }
  std::vector<std::uint8_t>& bytes() { return bytes_; }
  const std::vector<std::uint8_t>& bytes() const { return bytes_; }
  [[noreturn]] void fail(std::size_t at, const std::string& message) const;

 private:
  std::uint32_t number(std::size_t at, int count) const;
  void set_number(std::size_t at, std::uint32_t value, int count);

  std::string file_, name_;
  std::uint64_t offset_ = 0;
  ByteOrder order_ = ByteOrder::little;
  std::vector<std::uint8_t> bytes_;
};

/// A file of which some spans become others, while the bytes between them stay.
class FileChange {
 public:
  explicit FileChange(const BinaryFile& kept) : kept_(kept) {}
  using Fill = ContainerOutput::Fill;
  /// Bytes [at, at + size) become `new_size` others. Spans do not overlap; of several of size 0 at the
  /// same place the first comes first. Returns the span's number.
  std::size_t replace(std::uint64_t at, std::uint64_t size, std::uint64_t new_size);
  /// All spans are known: from now on places can be asked for.
  void lay_out();
  /// Where a byte that stays comes to lie; of a byte inside of a span, as far in it where it keeps its
  /// size, else where it begins.
  std::uint64_t moved(std::uint64_t at) const;
  /// Where the new bytes of a span lie.
  std::uint64_t place(std::size_t span) const { return spans_[span].place; }
  std::uint64_t new_size() const;
  void fill(std::size_t span, std::vector<std::uint8_t> bytes);
  void fill(std::size_t span, Fill make, std::size_t number);
  void add_to(BinaryOutput& output);

 private:
  struct Span {
    std::uint64_t at, size, new_size, place = 0;
    Fill make;
    std::size_t number = 0;
  };
  const BinaryFile& kept_;
  std::vector<Span> spans_;
  std::vector<std::size_t> order_;  ///< by place
};

/// What a piece of a layer becomes in a changed file.
struct PieceSpan {
  std::size_t span = 0;
  bool owns = true;  ///< whether the span is made for this piece
};
/// Bytes of a kept file, and the pieces that lie in them. Layers that look the same may share.
struct SharedBytes {
  std::uint64_t at = 0, size = 0;
  std::vector<std::size_t> pieces;  ///< of those that are written; none: the bytes go
};
/// Replaces them by the new code of the pieces, each behind `head_bytes` bytes; pieces that shared
/// still do where they are alike. `spans` has a place for each piece.
void replace_shared(FileChange& change, const CodedLayers& layers, std::uint64_t head_bytes,
                    const std::vector<SharedBytes>& kept, std::vector<PieceSpan>& spans);

/// The same of the layers of a file in which each is one piece, at `kept` with its head: a span for each of
/// `layers` that are written, those that are added behind all that are kept.
std::vector<PieceSpan> replace_layers(FileChange& change, const CodedLayers& coded,
                                      std::uint64_t head_bytes,
                                      const std::vector<ArchiveContents::Place>& kept,
                                      std::size_t layers);
/// Throws `InputError` where a file would be larger than its offsets of 32 bits can say.
void check_offsets_fit(const FileChange& change, const BinaryFile& file);

/// What a format's layers need in common: throws `InputError` where sizes or counts are absurd.
void check_image_size(const Container& file, std::uint32_t width_px, std::uint32_t height_px);
void check_layer_count(const BinaryFile& file, std::uint64_t layers);
/// Who may use the same bytes as others of its kind.
enum class Sharing { none, layers, previews };
/// Spans of bytes that must lie in the file and not overlap: of [offset, offset + size), named.
struct NamedSpan {
  std::uint64_t offset, size;
  std::string name;
  Sharing sharing = Sharing::none;
};
void check_spans(const BinaryFile& file, std::vector<NamedSpan> spans);

/// RGB565 of a grey picture in the middle of a black one, as words.
std::vector<std::uint16_t> rgb565_preview(const GreyImage& preview, int width_px, int height_px);
/// The same as bytes, highest first, row by row.
std::vector<std::uint8_t> rgb565_bytes(const GreyImage& preview, int width_px, int height_px);
/// The brightness of a pixel of RGB565, by the weights of red, green and blue that eyes have.
std::uint8_t grey_of_rgb565(std::uint32_t word);

/// Times of the layers of the stack that is written, s.
std::vector<double> layer_times(const StackInfo& info);
/// The time that a printer says a print takes, s, for other layers and times: what it takes for a
/// layer besides its light stays.
std::uint32_t changed_print_time_s(std::uint32_t print_time_s, const StackInfo& old_info,
                                   const StackInfo& new_info);
/// Bottom, fade and normal times of a kept file that are written into its head, where a file knows
/// nothing of layers; throws `InputError` when the stack needs more.
void require_even_times(const ArchiveRequest& request, const ExposureSummary& times,
                        const char* why);

}  // namespace slicecorr::detail
