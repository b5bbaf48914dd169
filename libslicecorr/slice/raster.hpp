/// Coverage of pixels by the region that directed segments enclose, non-zero winding rule.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

namespace slicecorr::detail {

/// A directed piece of a contour, in pixels; y grows with the image row.
struct Segment {
  double ax, ay, bx, by;
};

/// Draws the segments of one slice into the rows of a band. Reused from slice to slice, so that
/// nothing is allocated per slice. One object for one thread.
///
/// The result of a row depends on the segments that cross it and on their order alone, not on the
/// band.
class Raster {
 public:
  /// Rows [y0, y1), columns [x0, x1). No segment may leave the columns.
  Raster(int x0, int y0, int x1, int y1, bool antialias);

  void clear();
  void add(const Segment& s);
  /// Writes (y1 - y0) * (x1 - x0) bytes. False when all are 0.
  bool draw(std::uint8_t* rows);

 private:
  /// A piece within one row; y from 0 to 1 in the row and y0 < y1. Or a horizontal one, from left
  /// to right and of winding 0, that only keeps the pieces at its two ends in one cluster.
  struct Piece {
    double x0, y0, x1, y1;
    int winding;  ///< +1: the contour goes down here (y grows), -1: up
    double at(double y) const {
      // Exact at the ends, so that pieces that meet there meet exactly.
      if (y <= y0) return x0;
      if (y >= y1) return x1;
      return x0 + (y - y0) * ((x1 - x0) / (y1 - y0));
    }
    double left() const { return x0 < x1 ? x0 : x1; }
    double right() const { return x0 < x1 ? x1 : x0; }
  };
  struct Crossing {
    double x;
    int winding;
  };
  struct Active {
    const Piece* piece;
    double x;      ///< at the upper side of the strip
    double x_end;  ///< at its lower side
  };

  bool draw_area_row(std::vector<Piece>& pieces, std::uint8_t* row);
  bool draw_centre_row(std::vector<Crossing>& crossings, std::uint8_t* row) const;
  void draw_cluster(const Piece* begin, const Piece* end, int winding);
  void draw_strip(double from, double to, int winding);
  void accumulate(double xa, double xb, double height);

  int x0_, y0_, x1_, y1_;
  bool antialias_;
  std::vector<std::vector<Piece>> pieces_;        ///< per row
  std::vector<std::vector<Crossing>> crossings_;  ///< per row
  /// Per pixel: what is to be added to the running sum of areas from the left. All zero between
  /// rows.
  std::vector<double> area_;
  std::vector<double> events_;
  std::vector<const Piece*> by_start_;
  std::vector<Active> active_;
};

}  // namespace slicecorr::detail
