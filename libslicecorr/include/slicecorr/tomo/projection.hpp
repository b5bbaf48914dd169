// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file tomo/projection.hpp
/// What finding light needs to know of light and resin: how their numbers lie in memory, which cells
/// are to gel, and the two operators between light and dose, exact transposes of each other. Where
/// the light comes from is for others to know: from all around a vial that turns
/// (tomo/projector.hpp), or along the axes of a vat (tomo/beams.hpp).
///
/// Cells lie in slices, and these in blocks: the slices of a block are innermost in memory, one per
/// vector lane. Slices are problems of their own, unless they share light: then all are one block.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <new>
#include <vector>

#include "slicecorr/parallel.hpp"

namespace slicecorr::tomo {

/// Allocates at cache lines, so that no vector register is loaded from two of them.
template <class T>
struct CacheLineAllocator {
  using value_type = T;
  static constexpr std::align_val_t kAlignment{64};
  CacheLineAllocator() = default;
  template <class U>
  CacheLineAllocator(const CacheLineAllocator<U>&) {}  // NOLINT: as std::allocator
  T* allocate(std::size_t n) { return static_cast<T*>(::operator new(n * sizeof(T), kAlignment)); }
  void deallocate(T* p, std::size_t) { ::operator delete(p, kAlignment); }
  bool operator==(const CacheLineAllocator&) const = default;
};
template <class T>
using Array = std::vector<T, CacheLineAllocator<T>>;

/// How a field, a number per cell, and light, a number per ray, lie in memory: block after block.
struct Shape {
  int slices = 1;
  /// Slices per block, and so the number of lanes: number i of a block of a field, or of light that
  /// slices don't share, is of lane i % lanes. The last block may hold fewer slices, its other lanes
  /// are 0 and stay 0.
  int lanes = 1;
  bool coupled = false;            ///< slices share light, as one block
  std::size_t field_of_block = 0;  ///< numbers
  std::size_t light_of_block = 0;

  std::size_t blocks() const { return (static_cast<std::size_t>(slices) + lanes - 1) / lanes; }
  std::size_t field() const { return blocks() * field_of_block; }
  std::size_t light() const { return blocks() * light_of_block; }
  int lanes_used(std::size_t block) const;
  /// How many parts of the light nothing else depends on: slices, or all of them as one.
  int problems() const { return coupled ? 1 : slices; }
  /// The same of a block: its lanes are problems of their own, or all one.
  int problem_lanes() const { return coupled ? 1 : lanes; }
  int problems_of(std::size_t block) const { return coupled ? 1 : lanes_used(block); }

  /// Lanes of slices that share light, in cache lines of 16; many of them an odd number, as columns
  /// of cells that are a power of two apart would share few places in a cache.
  static int all_lanes(int slices) {
    const int lines = (slices + 15) / 16;
    return 16 * (lines > 7 ? lines | 1 : lines);
  }

  bool operator==(const Shape&) const = default;
};

/// What the solver and the metrics take a cell for.
enum class Kind : std::uint8_t { neither, gel, empty };

/// Kinds of all cells, laid out as a field.
struct CellKinds {
  Array<Kind> kinds;
  std::size_t gel = 0, empty = 0;  ///< numbers of gel and of void cells
  /// Doses that are wanted of each cell, laid out as the kinds; empty: kinds say all. In cells without
  /// a least (0) a rung lowers the most, as in void. Infinite: no most.
  Array<float> least, most;
  /// What being outside costs, its square root; 0: nothing; empty: 1 everywhere.
  Array<float> weight;
  bool banded() const { return !least.empty(); }
};

/// Thread-safe: projectors are const once made.
class Projector {
 public:
  virtual ~Projector() = default;
  virtual Shape shape() const = 0;
  /// light = A field, of one block. Work is shared among the context's threads; its callbacks are not
  /// called.
  virtual void forward(std::size_t block, const float* field, float* light,
                       const ExecutionContext& context) const = 0;
  /// field = A^T light, of one block. Where no cell is it becomes 0.
  virtual void adjoint(std::size_t block, const float* light, float* field,
                       const ExecutionContext& context) const = 0;
  /// The same for these slices alone, in this order. Throws `InputError` where they share light.
  virtual std::unique_ptr<Projector> of_slices(const std::vector<int>& slices) const;
};

/// How a block may run where this context has so many of them to run at once: with the threads that
/// are left to each, and silent.
ExecutionContext inside_block(const ExecutionContext& context, std::size_t blocks);

/// All blocks, in place of what `light` or `field` holds; the same bytes for any number of threads.
void forward(const Projector& projector, const ExecutionContext& context, const Array<float>& field,
             Array<float>& light);
void adjoint(const Projector& projector, const ExecutionContext& context, const Array<float>& light,
             Array<float>& field);

}  // namespace slicecorr::tomo
