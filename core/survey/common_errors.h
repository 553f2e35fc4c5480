// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Errors that many columns and scans share, estimated from residuals of columns.
#pragma once

#include <Eigen/Dense>
#include <utility>

namespace soilvdb::inline v0 {

/// A column's measured height less its predicted one, as the model has it:
///
///     prediction   u = -b . c - e     e of variance `variance`, the column's own
///     measurement  r = u + a . c + v  v of variance 1 / weight
///
/// u is the column's correction, c are the common errors.
struct ColumnResidual {
  double residual = 0;  ///< r, m
  double weight = 0;    ///< 1 / m^2; 0: not seen
  double variance = 0;  ///< m^2
};

/// The common errors c of one linear problem. Corrections are eliminated, so that it costs as much
/// as there are columns. Exact: it is the least-squares solution.
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

  /// Adds a column, or the mean of a block of columns whose own errors hang together.
  /// @param sees a - b
  void add(const ColumnResidual& column, const Eigen::VectorXd& sees) {
    const double weight = 1 / (column.variance + 1 / column.weight);
    const Eigen::VectorXd weighted = weight * sees;
    for (Eigen::Index i = 0; i < sees.size(); ++i)  // most sensors saw nothing of it
      if (sees[i] != 0) information_.col(i) += sees[i] * weighted;
    sum_ += weight * column.residual * sees;
  }
  void solve() {
    const Eigen::MatrixXd inverse = information_.ldlt().solve(
        Eigen::MatrixXd::Identity(information_.rows(), information_.cols()));
    covariance_ = (inverse + inverse.transpose()) / 2;  // the same bits on both sides
    mean_ = covariance_ * sum_;
  }

  const Eigen::VectorXd& mean() const { return mean_; }
  const Eigen::MatrixXd& covariance() const { return covariance_; }

  /// A column's correction u, and how it depends on the common errors.
  struct Correction {
    double mean = 0;     ///< m
    double own = 0;      ///< variance without that of the common errors, m^2
    Eigen::VectorXd on;  ///< the correction's error is `own` and on . (error of c)
    double variance(const CommonErrors& errors) const {
      return own + on.dot(errors.covariance() * on);
    }
  };
  /// @param measured a
  /// @param predicted b
  /// @param to keeps its storage
  template <typename A, typename B>
  void correct(const ColumnResidual& column, const Eigen::MatrixBase<A>& measured,
               const Eigen::MatrixBase<B>& predicted, Correction& to) const {
    const double prior = 1 / column.variance, all = prior + column.weight;
    to.on = (column.weight / all) * measured + (prior / all) * predicted;
    to.mean = column.weight / all * column.residual - to.on.dot(mean_);
    to.own = 1 / all;
  }

 private:
  Eigen::MatrixXd information_;
  Eigen::VectorXd sum_, mean_;
  Eigen::MatrixXd covariance_;
};

}  // namespace soilvdb::inline v0
