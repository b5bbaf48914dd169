#include "pipeline/coded_stack.hpp"

#include <algorithm>
#include <utility>

#include "cure/shown_slices.hpp"

namespace slicecorr::detail {

CodedStack::CodedStack(const Grid& grid, const ImageFrame& frame, std::vector<PixelBox> bands,
                       const std::string& scratch_folder, const ExecutionContext& context)
    : grid_(grid),
      frame_(frame),
      bands_(std::move(bands)),
      held_(bands_.size()),
      store_(scratch_folder, kMemoryBytes, context) {
  for (const PixelBox& band : bands_) bounds_ = bounds_.united(band);
}

void CodedStack::put(std::size_t band, const CodedBand& coded) {
  held_[band] = {store_.put(coded.code().data(), coded.code().size()), coded.ends()};
}

void CodedStack::read_band(const PixelBox& band, const Sink& sink) const {
  /// What of one of the bands lies in that which is asked for.
  struct Part {
    PixelBox box;  ///< of the band
    int y0, y1;    ///< rows in common
    CodedBand coded;
  };
  std::vector<Part> parts;
  for (std::size_t i = 0; i < bands_.size(); ++i) {
    const PixelBox& box = bands_[i];
    const int y0 = std::max(box.y0, band.y0), y1 = std::min(box.y1, band.y1);
    if (y0 >= y1 || held_[i].ends.empty()) continue;
    std::vector<std::uint8_t> code;
    store_.get(held_[i].code, code);
    parts.push_back({box, y0, y1, CodedBand(columns_of(box), std::move(code), held_[i].ends)});
  }
  const auto width = static_cast<std::size_t>(band.width());
  std::vector<std::uint8_t> rows(columns_of(band), 0), of_part;
  for (int n = 0; n < grid_.layers; ++n) {
    bool lit = false;
    for (const Part& part : parts) {
      const bool black = n >= part.coded.slices() || part.coded.black(n);
      const auto first = static_cast<std::size_t>(part.y0 - band.y0) * width;
      const auto count = static_cast<std::size_t>(part.y1 - part.y0);
      if (black) {
        std::fill_n(rows.begin() + static_cast<std::ptrdiff_t>(first), count * width,
                    std::uint8_t{0});
        continue;
      }
      lit = true;
      of_part.resize(part.coded.columns());
      part.coded.read(n, of_part.data());
      const int x0 = std::max(band.x0, part.box.x0), x1 = std::min(band.x1, part.box.x1);
      for (int y = part.y0; y < part.y1 && x0 < x1; ++y) {
        std::copy_n(of_part.begin() +
                        static_cast<std::ptrdiff_t>(y - part.box.y0) * part.box.width() +
                        (x0 - part.box.x0),
                    x1 - x0,
                    rows.begin() + static_cast<std::ptrdiff_t>(y - band.y0) * band.width() +
                        (x0 - band.x0));
      }
    }
    sink(n, lit ? rows.data() : nullptr);
  }
}

}  // namespace slicecorr::detail
