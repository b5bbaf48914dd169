// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Makes libslicecorr/picture/dejavu_letters.hpp of a font, once: pictures then have the same letters everywhere.
//   cc scripts/letters.c $(pkg-config --cflags --libs freetype2) -o letters
//   ./letters /usr/share/fonts/truetype/dejavu/DejaVuSans.ttf >libslicecorr/picture/dejavu_letters.hpp
#include <ft2build.h>
#include FT_FREETYPE_H
#include <stdio.h>

static void letter(FT_Face face, unsigned code) {
  if (FT_Load_Char(face, code, FT_LOAD_RENDER | FT_LOAD_NO_HINTING)) return;
  const FT_GlyphSlot g = face->glyph;
  printf("    {0x%02X, %d, %d, %u, %u, %ld,", code, g->bitmap_left, g->bitmap_top, g->bitmap.width,
         g->bitmap.rows, (g->linearHoriAdvance + 0x8000) >> 16);
  unsigned column = 200;
  for (unsigned y = 0; y < g->bitmap.rows; ++y) {
    for (unsigned x = 0; x < g->bitmap.width; ++x, ++column) {
      if (column >= 90) {
        printf("%s\n     \"", column < 200 ? "\"" : "");
        column = 0;
      }
      printf("%x", (g->bitmap.buffer[y * g->bitmap.pitch + x] * 15 + 127) / 255);
    }
  }
  printf("%s},\n", column < 200 ? "\"" : " \"\"");
}

int main(int argc, char** argv) {
  static const unsigned more[] = {0xB0, 0xB1,   0xB2,   0xB3,   0xB5,   0xB7,
                                  0xD7, 0x2013, 0x2014, 0x2019, 0x2026, 0x2212};
  FT_Library library;
  FT_Face face;
  if (argc != 2 || FT_Init_FreeType(&library) || FT_New_Face(library, argv[1], 0, &face) ||
      FT_Set_Pixel_Sizes(face, 0, 28))
    return 2;
  // REUSE-IgnoreStart
  printf(
      "// SPDX-FileCopyrightText: 2003 Bitstream, Inc.\n"
      "// SPDX-License-Identifier: Bitstream-Vera\n\n"
      // REUSE-IgnoreEnd
      "/// Letters of DejaVu Sans 2.37, 28 pixels high, as scripts/letters.c draws them by FreeType: code, what lies\n"
      "/// left of the picture and its top above the line, width, height, way to the next letter; then how much of\n"
      "/// each pixel is ink, a hexadecimal digit each. In the order of codes.\n"
      "#pragma once\n\n#include <cstdint>\n\nnamespace slicecorr::detail {\n\n"
      "struct InkLetter {\n  std::uint16_t code;\n  std::int8_t left, top;\n  std::uint8_t width, height, advance;\n"
      "  const char* ink;\n};\n\n// clang-format off\ninline constexpr InkLetter kDejaVuLetters[] = {\n");
  for (unsigned c = ' '; c <= '~'; ++c) letter(face, c);
  for (unsigned i = 0; i < sizeof more / sizeof *more; ++i) letter(face, more[i]);
  printf("};\n// clang-format on\n\n}  // namespace slicecorr::detail\n");
  return 0;
}
