// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// The page that goes with a part to measure, to be printed and written on.
#pragma once

#include <string>
#include <vector>

#include "slicecorr/grid.hpp"
#include "support/page/html_page.hpp"

namespace slicecorr::detail {

/// What a page says.
struct PartSheet {
  std::string title, about;
  std::vector<page::Markup> tools, steps;
  page::Markup picture;
  std::string caption;
  std::vector<std::string> heads;              ///< of the table; the last column is left empty
  std::vector<std::vector<std::string>> rows;  ///< cells without the last
  page::Markup after;                          ///< what to do with the table
  std::vector<std::string> commands;
};
std::string sheet_page(const PartSheet& sheet);

/// A box of the plate with words in it, or below it where they don't fit.
struct SheetBox {
  PixelBox box;
  double light = 1;  ///< in shares of full light
  std::string words;
};
/// The plate from above, as the images of the stack show it.
page::Markup plate_picture(const Grid& grid, const std::vector<SheetBox>& boxes);

}  // namespace slicecorr::detail
