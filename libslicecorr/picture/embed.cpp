// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "picture/embed.hpp"

#include <libdeflate.h>

#include <algorithm>
#include <memory>
#include <new>

#include "support/text/base64.hpp"

namespace slicecorr::detail {

page::Markup captioned_image(const ColourImage& picture, const std::string& words) {
  return page::captioned(
      page::markup(R"(<img alt="{}" width="{}" height="{}" src="data:image/png;base64,{}">)", words,
                   picture.width_px, picture.height_px, base64(encode_png(picture))),
      words);
}

bool deflate_within(std::size_t most, const Bytes& raw, Bytes& out) {
  const std::unique_ptr<libdeflate_compressor, decltype(&libdeflate_free_compressor)> compressor(
      libdeflate_alloc_compressor(4), libdeflate_free_compressor);
  if (!compressor) throw std::bad_alloc();
  out.resize(std::min(most, libdeflate_zlib_compress_bound(compressor.get(), raw.size())));
  out.resize(
      libdeflate_zlib_compress(compressor.get(), raw.data(), raw.size(), out.data(), out.size()));
  return !out.empty();
}

Bytes deflated(const Bytes& raw) {
  Bytes out;
  deflate_within(SIZE_MAX, raw, out);
  return out;
}

}  // namespace slicecorr::detail
