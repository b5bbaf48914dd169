// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file run_deflate.hpp
/// Deflate for bytes that come as runs: slices.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "stack/png/huffman.hpp"

namespace slicecorr::detail {

/// Compresses a piece to deflate blocks that end on a byte, are not the last ones and match nothing
/// before the piece, so that pieces can be joined in any number. The output follows from the bytes
/// alone, on every processor. Reusable, not thread-safe.
///
/// In one pass bytes become tokens: literals, then a run of the last of them; every run of four or
/// more equal bytes is one, so that tokens don't depend on how the bytes were handed over. Tokens
/// that have been seen before, literals and run alike, become matches of up to 258 bytes: what
/// repeats from row to row and along a row. Then one code is made for the whole piece. Work per
/// byte is one comparison with its neighbour, everything else is per token.
class RunDeflater {
 public:
  /// Starts a new piece.
  void clear();
  /// The piece's next bytes: zeros, or those given.
  void add_zeros(std::size_t n);
  void add(const std::uint8_t* bytes, std::size_t n);
  /// Ends the piece; to be called before any of the functions below.
  void end();
  /// Whether the piece is nothing but zeros.
  bool only_zeros() const;
  /// Whether the piece has the bytes of the last one that was written.
  bool repeats_last() const;
  /// Appends the piece to `out`.
  void write(std::vector<std::uint8_t>& out);

 private:
  struct Token {
    std::uint32_t literals;  ///< bytes as they are, then ...
    std::uint32_t run;       ///< ... so many that equal the last of them: 0 or at least 3
    bool operator==(const Token&) const = default;
  };
  /// Literals that are written, then a match: tokens that are left out because they repeat earlier
  /// bytes.
  struct Match {
    std::uint32_t literals, matched_literals;
    std::uint32_t length, distance;  ///< of any length where the distance is 1
  };

  void make_room(std::size_t n);
  void end_run();
  void start_run(std::uint8_t value);
  void add_byte(std::uint8_t value);
  void add_block(const std::uint8_t* bytes, std::size_t at, std::uint64_t starts);
  /// Compares the tokens from `at` on with those from `before` on, and keeps a match where it pays.
  /// Returns the number of tokens that it replaces; 0: none.
  std::size_t find_match(std::size_t at, std::size_t before);
  void find_matches();
  void count_symbols();
  void write_matches(BitWriter& out) const;

  struct Tokens {
    std::vector<std::uint8_t> literals;
    std::size_t literal_count = 0;
    std::vector<Token> tokens;
    std::size_t token_count = 0;
  };
  Tokens now_, last_;  ///< of this piece, and of the last that was written
  bool written_ = false;
  std::size_t token_start_ = 0;         ///< first literal of the present token
  std::uint32_t value_ = 0;             ///< of the present run; above 255: none
  std::size_t run_ = 0;                 ///< its length, without the first byte
  std::vector<std::uint64_t> changes_;  ///< of the bytes being added, 64 a word

  struct TokenStart {
    std::uint32_t raw, literal;  ///< where a token starts, in the piece and among the literals
  };
  std::vector<TokenStart> token_starts_;
  std::vector<Match> matches_;
  /// Last token of each hash, plus `first_id_`; what is less is of an earlier piece.
  std::vector<std::uint32_t> seen_;
  std::uint32_t first_id_ = 1;

  std::array<std::uint32_t, kLiteralSymbols> literal_frequencies_;
  std::array<std::uint32_t, kDistanceSymbols> distance_frequencies_;
  std::uint64_t extra_bits_ = 0;
  HuffmanCode literal_code_, distance_code_;
  DynamicHeader header_;
};

}  // namespace slicecorr::detail
