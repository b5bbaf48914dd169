// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file least_squares.hpp
/// Small least-squares problems with linear bounds. Private to the module.
#pragma once

#include <Eigen/Core>

namespace slicecorr::disc {

/// The x that makes |M x - y|^2 least under A x <= b; a point inside of all bounds must exist. A ridge
/// of 1e-12 of M's greatest column decides where M leaves x open. By Mehrotra's predictor and
/// corrector, to 1e-9 of b and of M'y in some 20 rounds; the cost is rows times unknowns squared a
/// round. Always the same bits.
Eigen::VectorXd bounded_least_squares(const Eigen::MatrixXd& M, const Eigen::VectorXd& y,
                                      const Eigen::MatrixXd& A, const Eigen::VectorXd& b);

}  // namespace slicecorr::disc
