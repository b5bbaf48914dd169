// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "stack/formats/binary_block.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <map>
#include <numeric>

#include "slicecorr/error.hpp"
#include "slicecorr/image_size.hpp"
#include "stack/png/preview.hpp"

namespace slicecorr::detail {

BinaryBlock::BinaryBlock(const BinaryFile& file, std::uint64_t offset, std::uint64_t size,
                         std::string name, ByteOrder order)
    : file_(file.path()), name_(std::move(name)), offset_(offset), order_(order) {
  file.read_at(offset, size, bytes_, name_);
}

void BinaryBlock::fail(std::size_t at, const std::string& message) const {
  throw InputError(file_, fmt::format("{}, byte {:X}h", name_, offset_ + at), message);
}

std::uint32_t BinaryBlock::number(std::size_t at, int count) const {
  if (at + static_cast<std::size_t>(count) > bytes_.size()) {
    throw Error("a number beyond the end of its block");
  }
  std::uint32_t value = 0;
  for (int i = 0; i < count; ++i) {
    const int k = order_ == ByteOrder::big ? i : count - 1 - i;
    value = value << 8 | bytes_[at + static_cast<std::size_t>(k)];
  }
  return value;
}

void BinaryBlock::set_number(std::size_t at, std::uint32_t value, int count) {
  const int bits = 8 * count;
  if (bits < 32 && value >> bits != 0) {
    fail(at, fmt::format("can't hold {}; expected at most {}", value, (1u << bits) - 1));
  }
  for (int i = 0; i < count; ++i) {
    const int k = order_ == ByteOrder::big ? count - 1 - i : i;
    bytes_.at(at + static_cast<std::size_t>(k)) = static_cast<std::uint8_t>(value >> (8 * i));
  }
}

float BinaryBlock::f32(std::size_t at) const { return std::bit_cast<float>(u32(at)); }

double BinaryBlock::real(std::size_t at, const char* what, double most) const {
  const float value = f32(at);
  if (!(value >= 0 && value <= most)) {
    fail(at, fmt::format("{} is {}, expected 0 to {:g}", what, value, most));
  }
  // As short as the text that somebody typed: 0.05, not 0.05000000074505806.
  return std::stod(fmt::format("{:.7g}", value));
}

void BinaryBlock::set_f32(std::size_t at, double value) {
  set_u32(at, std::bit_cast<std::uint32_t>(static_cast<float>(value)));
}

std::string BinaryBlock::text(std::size_t at, std::size_t most_bytes) const {
  std::string text;
  for (std::size_t i = at; i < at + most_bytes && bytes_.at(i) != 0; ++i) {
    text.push_back(static_cast<char>(bytes_[i]));
  }
  return shown_name(text);
}

void BinaryBlock::set_text(std::size_t at, std::size_t most_bytes, const std::string& text) {
  std::fill_n(bytes_.begin() + static_cast<std::ptrdiff_t>(at), most_bytes, std::uint8_t{0});
  set_bytes(at, std::string_view(text).substr(0, most_bytes - 1));
}

void BinaryBlock::set_bytes(std::size_t at, std::string_view bytes) {
  if (at + bytes.size() > bytes_.size()) throw Error("bytes beyond the end of their block");
  std::copy(bytes.begin(), bytes.end(), bytes_.begin() + static_cast<std::ptrdiff_t>(at));
}

std::size_t FileChange::replace(std::uint64_t at, std::uint64_t size, std::uint64_t new_size) {
  spans_.push_back({at, size, new_size, 0, {}, 0});
  return spans_.size() - 1;
}

void FileChange::lay_out() {
  order_.resize(spans_.size());
  std::iota(order_.begin(), order_.end(), std::size_t{0});
  // What is put between two parts comes before the second of them.
  const auto key = [&](std::size_t i) { return std::pair(spans_[i].at, spans_[i].size > 0); };
  std::stable_sort(order_.begin(), order_.end(),
                   [&](std::size_t a, std::size_t b) { return key(a) < key(b); });
  std::uint64_t from = 0, to = 0;
  for (const std::size_t i : order_) {
    Span& span = spans_[i];
    if (span.at < from) throw Error("changes of a file overlap");
    to += span.at - from;
    span.place = to;
    to += span.new_size;
    from = span.at + span.size;
  }
}

std::uint64_t FileChange::moved(std::uint64_t at) const {
  // The last span that starts at or before it.
  const auto after =
      std::upper_bound(order_.begin(), order_.end(), at,
                       [&](std::uint64_t a, std::size_t i) { return a < spans_[i].at; });
  if (after == order_.begin()) return at;
  const Span& span = spans_[*std::prev(after)];
  if (at < span.at + span.size) {
    return span.place + (span.new_size == span.size ? at - span.at : 0);
  }
  return span.place + span.new_size + (at - span.at - span.size);
}

std::uint64_t FileChange::new_size() const { return moved(kept_.size()); }

void FileChange::fill(std::size_t span, std::vector<std::uint8_t> bytes) {
  if (bytes.size() != spans_[span].new_size) throw Error("a span has not the promised size");
  spans_[span].make = [bytes = std::move(bytes)](std::size_t, std::vector<std::uint8_t>& out) {
    out = bytes;
  };
}

void FileChange::fill(std::size_t span, Fill make, std::size_t number) {
  spans_[span].make = std::move(make);
  spans_[span].number = number;
}

void FileChange::add_to(BinaryOutput& output) {
  constexpr std::uint64_t piece = std::uint64_t{8} << 20;
  const auto keep = [&](std::uint64_t from, std::uint64_t to) {
    for (; from < to; from += std::min(piece, to - from)) {
      const std::uint64_t size = std::min(piece, to - from);
      output.add_piece(size, [this_file = &kept_, from, size](std::size_t, auto& out) {
        this_file->read_at(from, size, out, "");
      });
    }
  };
  std::uint64_t from = 0;
  for (const std::size_t i : order_) {
    Span& span = spans_[i];
    keep(from, span.at);
    if (span.new_size > 0) output.add_piece(span.new_size, std::move(span.make), span.number);
    from = span.at + span.size;
  }
  keep(from, kept_.size());
}

void replace_shared(FileChange& change, const CodedLayers& layers, std::uint64_t head_bytes,
                    const std::vector<SharedBytes>& kept, std::vector<PieceSpan>& spans) {
  const auto code_of = [&](std::size_t piece) {
    std::vector<std::uint8_t> code;
    layers.append(piece, code);
    return code;
  };
  for (const SharedBytes& bytes : kept) {
    std::vector<std::size_t> made;
    for (const std::size_t piece : bytes.pieces) {
      const std::uint64_t size = layers.sizes[piece];
      const auto twin = std::find_if(made.begin(), made.end(), [&](std::size_t other) {
        return layers.sizes[other] == size && code_of(other) == code_of(piece);
      });
      if (twin != made.end()) {
        spans[piece] = {spans[*twin].span, false};
        continue;
      }
      const bool first = made.empty();
      spans[piece] = {change.replace(first ? bytes.at : bytes.at + bytes.size,
                                     first ? bytes.size : 0, head_bytes + size),
                      true};
      made.push_back(piece);
    }
    if (made.empty()) change.replace(bytes.at, bytes.size, 0);
  }
}

std::vector<PieceSpan> replace_layers(FileChange& change, const CodedLayers& coded,
                                      std::uint64_t head_bytes,
                                      const std::vector<ArchiveContents::Place>& kept,
                                      std::size_t layers) {
  std::map<std::uint64_t, SharedBytes> by_place;
  std::uint64_t end = 0;
  for (std::size_t n = 0; n < kept.size(); ++n) {
    SharedBytes& bytes = by_place[kept[n].offset];
    bytes.at = kept[n].offset;
    bytes.size = kept[n].size;
    if (n < layers) bytes.pieces.push_back(n);
    end = std::max(end, kept[n].offset + kept[n].size);
  }
  std::vector<SharedBytes> all;
  all.reserve(by_place.size());
  for (auto& [at, bytes] : by_place) all.push_back(std::move(bytes));
  std::vector<PieceSpan> spans(layers);
  replace_shared(change, coded, head_bytes, all, spans);
  for (std::size_t n = kept.size(); n < layers; ++n) {
    spans[n].span = change.replace(end, 0, head_bytes + coded.sizes[n]);
  }
  return spans;
}

void check_offsets_fit(const FileChange& change, const BinaryFile& file) {
  if (change.new_size() <= 0xffffffffu) return;
  throw InputError(file.path(), "", "would be larger than 4 GiB, which its offsets can't say");
}

void check_image_size(const Container& file, std::uint32_t width_px, std::uint32_t height_px) {
  constexpr std::uint32_t most_across = 32768;
  constexpr std::uint64_t most = std::uint64_t{1} << 28;
  if (width_px >= 1 && height_px >= 1 && width_px <= most_across && height_px <= most_across &&
      std::uint64_t{width_px} * height_px <= most) {
    return;
  }
  throw InputError(file.path(), "head",
                   fmt::format("says that images are {} x {} pixels, expected 1 to {} each and at "
                               "most {} in all",
                               width_px, height_px, most_across, most));
}

void check_layer_count(const BinaryFile& file, std::uint64_t layers) {
  if (layers >= 1 && layers <= 65535) return;
  throw InputError(file.path(), "head",
                   fmt::format("says that there are {} layers, expected 1 to 65535", layers));
}

void check_spans(const BinaryFile& file, std::vector<NamedSpan> spans) {
  std::stable_sort(spans.begin(), spans.end(), [](const NamedSpan& a, const NamedSpan& b) {
    return a.offset != b.offset ? a.offset < b.offset : a.size < b.size;
  });
  const NamedSpan* last = nullptr;
  for (const NamedSpan& s : spans) {
    if (s.offset > file.size() || s.size > file.size() - s.offset) {
      throw InputError(file.path(), s.name,
                       fmt::format("reaches from byte {} to {}, but the file ends at {}", s.offset,
                                   s.offset + s.size, file.size()));
    }
    if (s.size == 0) continue;
    const bool shared = last && s.offset == last->offset && s.size == last->size &&
                        s.sharing != Sharing::none && s.sharing == last->sharing;
    if (last && s.offset < last->offset + last->size && !shared) {
      throw InputError(file.path(), s.name,
                       fmt::format("overlaps {} at byte {}", last->name, s.offset));
    }
    last = &s;
  }
}

std::vector<std::uint16_t> rgb565_preview(const GreyImage& preview, int width_px, int height_px) {
  const GreyImage image = framed(preview, width_px, height_px);
  std::vector<std::uint16_t> words;
  words.reserve(image.pixels.size());
  for (const std::uint8_t v : image.pixels) {
    words.push_back(static_cast<std::uint16_t>((v >> 3) << 11 | (v >> 2) << 5 | v >> 3));
  }
  return words;
}

std::vector<std::uint8_t> rgb565_bytes(const GreyImage& preview, int width_px, int height_px) {
  std::vector<std::uint8_t> bytes;
  for (const std::uint16_t word : rgb565_preview(preview, width_px, height_px)) {
    bytes.push_back(static_cast<std::uint8_t>(word >> 8));
    bytes.push_back(static_cast<std::uint8_t>(word));
  }
  return bytes;
}

std::uint8_t grey_of_rgb565(std::uint32_t word) {
  // Weights of BT.601 in thousandths; the most that each colour can be is 31, 63 and 31.
  constexpr std::uint32_t red = 299, green = 587, blue = 114, five = 31, six = 63;
  const std::uint32_t sum = red * 255 * (word >> 11 & five) / five +
                            green * 255 * (word >> 5 & six) / six +
                            blue * 255 * (word & five) / five;
  return static_cast<std::uint8_t>((sum + 500) / 1000);
}

std::vector<double> layer_times(const StackInfo& info) {
  std::vector<double> times_s;
  times_s.reserve(static_cast<std::size_t>(info.grid.layers));
  for (int n = 0; n < info.grid.layers; ++n) times_s.push_back(light_on_of_layer(info, n));
  return times_s;
}

std::uint32_t changed_print_time_s(std::uint32_t print_time_s, const StackInfo& old_info,
                                   const StackInfo& new_info) {
  const auto sum = [](const std::vector<double>& times_s) {
    return std::accumulate(times_s.begin(), times_s.end(), 0.0);
  };
  const double old_s = sum(layer_times(old_info)), new_s = sum(layer_times(new_info));
  const bool same = old_info.grid.layers == new_info.grid.layers && std::abs(old_s - new_s) < 0.5;
  if (print_time_s == 0 || same) return print_time_s;
  const double beside_s = std::max(0.0, print_time_s - old_s) / old_info.grid.layers;
  return static_cast<std::uint32_t>(
      std::clamp(std::round(new_s + beside_s * new_info.grid.layers), 0.0, 4294967295.0));
}

void require_even_times(const ArchiveRequest& request, const ExposureSummary& times,
                        const char* why) {
  if (!times.uneven) return;
  throw InputError(request.kept->path(), "",
                   fmt::format("{}, so layers can't have times of their own; expected one time for "
                               "the first layers and one for all others",
                               why));
}

}  // namespace slicecorr::detail
