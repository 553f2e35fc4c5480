// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Errors that many columns and scans share, estimated from residuals of columns.
#pragma once

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

namespace soilvdb::inline v0 {

/// A column's measured height less its predicted one, as the model has it:
///
///     prediction   u = -b . c - l z - e   e of variance `variance`, the column's own
///     measurement  r = u + a . c + v      v of variance 1 / weight
///
/// u is the column's correction, c are the common errors. z, of variance 1, is what the errors of
/// all columns of a block have in common.
struct ColumnResidual {
  double residual = 0;  ///< r, m
  double weight = 0;    ///< 1 / m^2; 0: not seen
  double variance = 0;  ///< m^2
  double alike = 0;     ///< l, m

  /// Of u, but for the common errors.
  double whole_variance() const { return variance + alike * alike; }
};

/// What is known of a block's z, by its columns, if the common errors are c:
/// its mean is `mean` + `on` . c.
struct BlockError {
  double mean = 0, variance = 1;
  Eigen::VectorXd on;
};

/// What the columns of a block say together: sums over columns, of W l times what is named, where
/// 1 / W is the variance of r without z and c.
struct BlockResidual {
  double weight = 0, residual = 0;  ///< of l, of r
  Eigen::VectorXd sees;             ///< of a - b; empty: no column was added
  /// Of l, times the columns' places along both axes, and times these squared.
  std::array<double, 4> places = {};

  /// @param at place of the column in its block @param size of c
  template <typename Sees>
  void add(const ColumnResidual& column, const Eigen::MatrixBase<Sees>& a_less_b,
           const Eigen::Vector2d& at) {
    const double on = column.alike / (column.variance + 1 / column.weight);
    const double with = on * column.alike;
    if (sees.size() == 0) sees = Eigen::VectorXd::Zero(a_less_b.size()).eval();
    weight += with;
    residual += on * column.residual;
    sees += on * a_less_b;
    for (Eigen::Index k = 0; k < 2; ++k) {
      places[static_cast<std::size_t>(k)] += with * at[k];
      places[static_cast<std::size_t>(2 + k)] += with * at[k] * at[k];
    }
  }
  void add(const BlockResidual& other) {
    if (other.sees.size() == 0) return;
    if (sees.size() == 0) sees = Eigen::VectorXd::Zero(other.sees.size()).eval();
    weight += other.weight;
    residual += other.residual;
    sees += other.sees;
    for (std::size_t k = 0; k < places.size(); ++k) places[k] += other.places[k];
  }
  /// Share of a block of this side over which the columns spread.
  double extent(double side) const {
    double product = 1;
    for (std::size_t k = 0; k < 2; ++k) {
      const double mean = places[k] / weight;
      product *= 12 * std::max(0.0, places[k + 2] / weight - mean * mean) + 1;
    }
    return std::min(1.0, std::sqrt(product) / (side * side));
  }
  /// @param size of c
  BlockError error(Eigen::Index size) const {
    if (sees.size() == 0) return {0, 1, Eigen::VectorXd::Zero(size)};
    const double variance = 1 / (1 + weight);
    return {-variance * residual, variance, variance * sees};
  }
};

/// The common errors c of one linear problem. Corrections are eliminated, then what is alike in
/// blocks, so that it costs as much as there are columns. The least-squares solution, but that a
/// block's columns are taken to see c alike.
class CommonErrors {
 public:
  /// @param prior variances of the common errors
  explicit CommonErrors(const Eigen::VectorXd& prior)
      : information_(prior.cwiseInverse().asDiagonal()),
        sum_(Eigen::VectorXd::Zero(prior.size())),
        mean_(sum_),
        covariance_(prior.asDiagonal()) {}
  /// As they were solved.
  CommonErrors(Eigen::VectorXd mean, Eigen::MatrixXd covariance)
      : mean_(std::move(mean)), covariance_(std::move(covariance)) {}

  /// Adds a block. @param variance of z; more than 1 where z hangs together with other blocks'
  void add(const BlockResidual& block, double variance = 1) {
    if (!(block.weight > 0)) return;
    const double weight = 1 / (block.weight * (1 + variance * block.weight));
    const Eigen::VectorXd weighted = weight * block.sees;
    for (Eigen::Index i = 0; i < weighted.size(); ++i)  // most sensors saw nothing of it
      if (weighted[i] != 0) information_.col(i) += block.sees[i] * weighted;
    sum_ += block.residual * weighted;
  }
  void solve() {
    const Eigen::MatrixXd inverse = information_.ldlt().solve(
        Eigen::MatrixXd::Identity(information_.rows(), information_.cols()));
    covariance_ = (inverse + inverse.transpose()) / 2;  // the same bits on both sides
    mean_ = covariance_ * sum_;
  }

  const Eigen::VectorXd& mean() const { return mean_; }
  const Eigen::MatrixXd& covariance() const { return covariance_; }
  /// Mean of a block's z.
  double mean_of(const BlockError& block) const { return block.mean + block.on.dot(mean_); }

  /// A column's correction u, and how it depends on the errors that it shares.
  struct Correction {
    double mean = 0;          ///< m
    double own = 0;           ///< variance without those of the common errors and of z, m^2
    double alike = 0;         ///< error of u by that of z, m
    Eigen::VectorXd on;       ///< by those of the common errors, if z is known
    Eigen::VectorXd all, by;  ///< storage of variance()
  };
  /// @param measured a
  /// @param predicted b
  /// @param to keeps its storage
  template <typename A, typename B>
  void correct(const ColumnResidual& column, const BlockError& block,
               const Eigen::MatrixBase<A>& measured, const Eigen::MatrixBase<B>& predicted,
               Correction& to) const {
    const double prior = 1 / column.variance, all = prior + column.weight;
    to.on = (column.weight / all) * measured + (prior / all) * predicted;
    to.alike = prior / all * column.alike;
    to.mean = column.weight / all * column.residual - to.on.dot(mean_) - to.alike * mean_of(block);
    to.own = 1 / all;
  }
  double variance(Correction& of, const BlockError& block) const {
    auto &on = of.all, &by = of.by;
    on = of.on + of.alike * block.on;
    // Eigen's product costs several times as much, of so few errors.
    by.setZero(on.size());
    for (Eigen::Index i = 0; i < on.size(); ++i)
      if (on[i] != 0) by += on[i] * covariance_.col(i);
    return of.own + of.alike * of.alike * block.variance + on.dot(by);
  }

 private:
  Eigen::MatrixXd information_;
  Eigen::VectorXd sum_, mean_;
  Eigen::MatrixXd covariance_;
};

}  // namespace soilvdb::inline v0
