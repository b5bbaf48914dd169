// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Any bytes as a text of an archive, for clang's fuzzer; the first byte says of which. The archive is read or
// refused with an `InputError` that names the file; what is read is written back in its place, or
// refused as well, and then says the same.
#include "archive_texts.hpp"
#include "fuzz.hpp"
#include "slicecorr/pipeline.hpp"

using namespace slicecorr;

namespace {

bool same(const StackInfo& a, const StackInfo& b) {
  return a.grid.width_px == b.grid.width_px && a.grid.height_px == b.grid.height_px &&
         a.grid.layers == b.grid.layers && a.grid.pixel_x_um == b.grid.pixel_x_um &&
         a.grid.pixel_y_um == b.grid.pixel_y_um && a.grid.layer_um == b.grid.layer_um &&
         a.exposure_s == b.exposure_s && a.bottom_exposure_s == b.bottom_exposure_s &&
         a.bottom_layers == b.bottom_layers && a.layer_exposure_s == b.layer_exposure_s;
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const fuzz::Folder folder;
  static const std::vector<fuzz::ArchiveText> texts = fuzz::archive_texts();
  if (size == 0 || data[0] >= texts.size()) return -1;
  const fuzz::ArchiveText& text = texts[data[0]];
  test::Entries entries = text.entries;
  entries[text.entry].second.assign(data + 1, data + size);
  const std::string path = folder / text.file, out = folder / ("out_" + text.file);
  test::make_zip(path, entries);
  fuzz::read_or_refuse(
      [&] {
        const StackReader stack(path, folder.path(), fuzz::one_thread(), {50, 50, 50});
        StackFile file(out);
        file.format = stack.info().format;
        file.keep_from = path;
        convert_stack(stack, file, fuzz::one_thread());
        const StackReader back(out, folder.path(), fuzz::one_thread(), {50, 50, 50});
        if (!same(stack.info(), back.info()))
          fuzz::fail("written back, the archive says other things");
      },
      path, out);
  return 0;
}
