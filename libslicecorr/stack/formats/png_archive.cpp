// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "stack/formats/png_archive.hpp"

#include <libdeflate.h>
#include <zlib.h>

#include <new>

#include "slicecorr/error.hpp"
#include "stack/png/png.hpp"
#include "stack/png/run_deflate.hpp"

namespace slicecorr::detail {
namespace {

constexpr std::uint8_t kLastBlock[] = {3, 0};  // with nothing in it

}  // namespace

struct SmallIdat::Impl {
  libdeflate_decompressor* inflater = libdeflate_alloc_decompressor();
  z_stream stream{};
  bool stream_made = false;
  std::vector<std::uint8_t> piece, raw, by_zlib;
  RunDeflater by_runs;

  ~Impl() {
    libdeflate_free_decompressor(inflater);
    if (stream_made) deflateEnd(&stream);
  }
  /// Packs what the stream has as input.
  void run(int flush) {
    int result = Z_OK;
    do {
      const std::size_t start = by_zlib.size();
      by_zlib.resize(start + (std::size_t{64} << 10));
      stream.next_out = by_zlib.data() + start;
      stream.avail_out = static_cast<uInt>(by_zlib.size() - start);
      result = deflate(&stream, flush);
      by_zlib.resize(by_zlib.size() - stream.avail_out);
    } while (result == Z_OK && stream.avail_out == 0);
    if (result != (flush == Z_FINISH ? Z_STREAM_END : Z_OK) && result != Z_BUF_ERROR) {
      throw Error("deflating an image failed");
    }
  }
};

SmallIdat::SmallIdat() : impl_(std::make_unique<Impl>()) {
  z_stream& z = impl_->stream;
  impl_->stream_made = deflateInit2(&z, 9, Z_DEFLATED, -15, 9, Z_DEFAULT_STRATEGY) == Z_OK;
  if (impl_->inflater == nullptr || !impl_->stream_made) throw std::bad_alloc();
  impl_->by_runs.clear();
}

SmallIdat::~SmallIdat() = default;

void SmallIdat::add(std::span<const std::uint8_t> chunk, std::size_t raw_bytes) {
  Impl& s = *impl_;
  // Without length, type and checksum; ended, so that it stands for itself.
  s.piece.assign(chunk.begin() + 8, chunk.end() - 4);
  s.piece.insert(s.piece.end(), std::begin(kLastBlock), std::end(kLastBlock));
  s.raw.resize(raw_bytes);
  if (libdeflate_deflate_decompress(s.inflater, s.piece.data(), s.piece.size(), s.raw.data(),
                                    s.raw.size(), nullptr) != LIBDEFLATE_SUCCESS) {
    throw Error("an image's piece can't be read back");
  }
  s.stream.next_in = s.raw.data();
  s.stream.avail_in = static_cast<uInt>(s.raw.size());
  s.run(Z_NO_FLUSH);
  s.by_runs.add(s.raw.data(), s.raw.size());
}

void SmallIdat::finish(std::uint32_t adler, std::vector<std::uint8_t>& out) {
  Impl& s = *impl_;
  s.run(Z_FINISH);
  std::vector<std::uint8_t> runs;
  s.by_runs.end();
  s.by_runs.write(runs);
  runs.insert(runs.end(), std::begin(kLastBlock), std::end(kLastBlock));
  const std::vector<std::uint8_t>& smaller = runs.size() < s.by_zlib.size() ? runs : s.by_zlib;
  const std::size_t chunk = begin_chunk("IDAT", out);
  out.insert(out.end(), {0x78, 0xda});
  out.insert(out.end(), smaller.begin(), smaller.end());
  for (int shift = 24; shift >= 0; shift -= 8) {
    out.push_back(static_cast<std::uint8_t>(adler >> shift));
  }
  end_chunk(chunk, out);
}

}  // namespace slicecorr::detail
