// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Several displays as one.
#pragma once

#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "slicecorr/bridge/frames.hpp"

namespace slicecorr::bridge {

/// All of them show what the first one does, right after it. It counts.
class SeveralSinks : public FrameSink {
 public:
  explicit SeveralSinks(std::vector<std::unique_ptr<FrameSink>> sinks) : sinks_(std::move(sinks)) {}
  Shown show(const std::shared_ptr<const Frame>& frame, double at_s) override;
  void black() noexcept override;
  void tick(double at_s) override;
  void check() override;
  std::string describe() const override;

 protected:
  std::vector<std::unique_ptr<FrameSink>> sinks_;
};

}  // namespace slicecorr::bridge
