/// @file run_deflate.hpp
/// Deflate for bytes that come as runs: slices.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "stack/png/huffman.hpp"

namespace slicecorr::detail {

/// Compresses a piece to deflate blocks that end on a byte, are not the last ones and refer to
/// nothing before the piece, so that pieces can be joined in any number. The output follows from
/// the bytes alone, on every processor. Reusable, not thread-safe.
///
/// In one pass bytes become steps: literals, then a run of the last of them; every run of four or
/// more equal bytes is one, so that steps don't depend on how the bytes were handed over. Steps
/// that have been seen before, literals and run alike, become references of up to 258 bytes: what
/// repeats from row to row and along a row. Then one code is made for the whole piece. Work per
/// byte is one comparison with its neighbour, everything else is per step.
class RunDeflater {
 public:
  /// Starts a new piece.
  void clear();
  /// The piece's next bytes: zeros, or those given.
  void add_zeros(std::size_t n);
  void add(const std::uint8_t* bytes, std::size_t n);
  /// Ends the piece, before anything that follows here.
  void end();
  /// Whether the piece is nothing but zeros.
  bool only_zeros() const;
  /// Whether the piece has the bytes of the last one that was written.
  bool repeats_last() const;
  /// Appends the piece to `out`.
  void write(std::vector<std::uint8_t>& out);

 private:
  struct Step {
    std::uint32_t literals;  ///< bytes as they are, then ...
    std::uint32_t run;       ///< ... so many that equal the last of them: 0 or at least 3
    bool operator==(const Step&) const = default;
  };
  /// Some literals, a reference, and literals that are left out because it covers them.
  struct Order {
    std::uint32_t literals, covered;
    std::uint32_t length, distance;  ///< of any length where the distance is 1
  };

  void make_room(std::size_t n);
  void end_run();
  void start_run(std::uint8_t value);
  void add_byte(std::uint8_t value);
  void add_block(const std::uint8_t* bytes, std::size_t at, std::uint64_t starts);
  /// Steps from `at` on that equal those from `before` on, as far as one reference reaches: as an
  /// order where it pays. Returns the number of steps.
  std::size_t refer(std::size_t at, std::size_t before);
  void find_orders();
  void count_symbols();
  void write_orders(BitWriter& out) const;

  struct Steps {
    std::vector<std::uint8_t> literals;
    std::size_t literal_count = 0;
    std::vector<Step> steps;
    std::size_t step_count = 0;
  };
  Steps now_, last_;  ///< of this piece, and of the last that was written
  bool written_ = false;
  std::size_t step_start_ = 0;          ///< first literal of the step at hand
  std::uint32_t value_ = 0;             ///< of the run at hand; above 255: none
  std::size_t run_ = 0;                 ///< its length, without the first byte
  std::vector<std::uint64_t> changes_;  ///< of the bytes at hand, 64 a word

  struct Place {
    std::uint32_t raw, literal;  ///< where a step starts, in the piece and among the literals
  };
  std::vector<Place> places_;
  std::vector<Order> orders_;
  /// Last step of each hash, plus `first_id_`; what is less is of an earlier piece.
  std::vector<std::uint32_t> seen_;
  std::uint32_t first_id_ = 1;

  std::array<std::uint32_t, literal_symbols> literal_frequencies_;
  std::array<std::uint32_t, distance_symbols> distance_frequencies_;
  std::uint64_t extra_bits_ = 0;
  HuffmanCode literal_code_, distance_code_;
  DynamicHeader header_;
};

}  // namespace slicecorr::detail
