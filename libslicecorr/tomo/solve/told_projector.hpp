// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// A projector that tells how far a solve is.
#pragma once

#include <algorithm>
#include <atomic>
#include <cstdint>
#include <memory>
#include <utility>
#include <vector>

#include "slicecorr/parallel.hpp"
#include "slicecorr/tomo/solve.hpp"

namespace slicecorr::tomo::detail {

/// How often a solve uses A or A^T on a block, about: the ladder ends where a rung is missed.
inline double expected_calls(const SolveOptions& o, std::size_t blocks) {
  const auto steps = [&](int usual) { return static_cast<double>(o.steps > 0 ? o.steps : usual); };
  const auto each = static_cast<double>(blocks);
  switch (o.method) {
    case Method::osmo:
      return each * 4 * steps(20);
    case Method::kelly:
      return each * (2 * steps(10) + 4);
    case Method::fbp:
      return each * 3;
    case Method::ladder:
      break;
  }
  return each * 2 * (steps(60) * static_cast<double>(o.rungs.size()) + o.proof_steps);
}

/// Reports each block that `projector`, or one of some of its slices, has done as progress of the
/// stage "solving". `projector` and `context` must outlive this.
class ToldProjector final : public Projector {
 public:
  ToldProjector(const Projector& projector, const ExecutionContext& context, double expected)
      : projector_(projector),
        context_(context),
        expected_(expected),
        calls_(std::make_shared<std::atomic<std::int64_t>>(0)) {}

  Shape shape() const override { return projector_.shape(); }
  void forward(std::size_t block, const float* field, float* light,
               const ExecutionContext& context) const override {
    projector_.forward(block, field, light, context);
    tell();
  }
  void adjoint(std::size_t block, const float* light, float* field,
               const ExecutionContext& context) const override {
    projector_.adjoint(block, light, field, context);
    tell();
  }
  std::unique_ptr<Projector> of_slices(const std::vector<int>& slices) const override {
    return std::unique_ptr<Projector>(new ToldProjector(*this, projector_.of_slices(slices)));
  }

 private:
  ToldProjector(const ToldProjector& whole, std::unique_ptr<Projector> part)
      : kept_(std::move(part)),
        projector_(*kept_),
        context_(whole.context_),
        expected_(whole.expected_),
        calls_(whole.calls_) {}

  void tell() const {
    const auto done = static_cast<double>(calls_->fetch_add(1, std::memory_order_relaxed) + 1);
    context_.report("solving", std::min(done / expected_, 0.99));
  }

  std::unique_ptr<Projector> kept_;  ///< of some slices
  const Projector& projector_;
  const ExecutionContext& context_;
  double expected_;
  std::shared_ptr<std::atomic<std::int64_t>> calls_;
};

}  // namespace slicecorr::tomo::detail
