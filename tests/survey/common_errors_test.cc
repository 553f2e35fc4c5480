// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "core/survey/common_errors.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <vector>

namespace soilvdb {
namespace {

using Vector = Eigen::VectorXd;

constexpr double kMm = 1e-3;
constexpr double kExact = 1e-14;   // variance of a column without an error of its own, m^2
constexpr double kEndless = 1e14;  // weight of a column that was seen without end, 1 / m^2

Vector vector(std::initializer_list<double> values) {
  Vector v(static_cast<Eigen::Index>(values.size()));
  std::copy(values.begin(), values.end(), v.data());
  return v;
}

Vector variances(std::initializer_list<double> sigmas_mm) {
  return (kMm * vector(sigmas_mm)).cwiseAbs2();
}

double sigma_mm(const CommonErrors& errors, int n) {
  return std::sqrt(errors.covariance()(n, n)) / kMm;
}

/// Adds a column that is a block of its own.
void add(CommonErrors& errors, const Vector& a_less_b) {
  BlockResidual block;
  block.add({0, kEndless, 0, std::sqrt(kExact)}, a_less_b, {0, 0});
  errors.add(block);
}

CommonErrors::Correction correct(const CommonErrors& errors, const ColumnResidual& column,
                                 const Vector& measured, const Vector& predicted,
                                 const BlockResidual& block = {}) {
  CommonErrors::Correction made;
  errors.correct(column, block.error(measured.size()), measured, predicted, made);
  return made;
}

/// Sigma of a column's height after it was seen without end.
double height_mm(const CommonErrors& errors, const Vector& measured, const Vector& predicted) {
  auto correction = correct(errors, {0, kEndless, kExact}, measured, predicted);
  return std::sqrt(errors.variance(correction, BlockResidual{}.error(measured.size()))) / kMm;
}

TEST(CommonErrors, WhiteNoiseAveragesOut) {
  CommonErrors errors(variances({1e-9}));
  const auto correction = correct(errors, {0, 25 / (30 * kMm * 30 * kMm), 20 * kMm * 20 * kMm},
                                  vector({0}), vector({0}));
  EXPECT_NEAR(std::sqrt(correction.own) / kMm, 5.7470, 5e-5);
  EXPECT_NEAR(std::sqrt(4000.0) * 0.0025 * std::sqrt(correction.own), 0.00091, 5e-6);
}

TEST(CommonErrors, WhatTwoShareStaysHoweverOftenItIsSeen) {
  CommonErrors errors(variances({15, 10}));  // of the survey, of the sensor
  const Vector measured = vector({0, 1}), predicted = vector({1, 0});
  add(errors, measured - predicted);
  errors.solve();
  const double both = 15 * 10 / std::hypot(15, 10);
  EXPECT_NEAR(sigma_mm(errors, 0), both, 1e-4);
  EXPECT_NEAR(both, 8.3205, 5e-5);
  // 10 m^2 of columns of 5 cm: all err alike.
  const auto column = correct(errors, {0, kEndless, kExact}, measured, predicted);
  const Vector on = 4000 * column.on;
  EXPECT_NEAR(0.0025 * std::sqrt(4000 * column.own + on.dot(errors.covariance() * on)), 0.0832,
              5e-5);
}

TEST(CommonErrors, DugGroundAloneLeavesLipAndSensorTogether) {
  CommonErrors errors(variances({20, 10}));  // of the lip, of the sensor
  add(errors, vector({0, 1}) - vector({1, 0}));
  errors.solve();
  EXPECT_NEAR(sigma_mm(errors, 0), 8.9443, 5e-5);
}

/// Dug and natural ground are seen. Common errors: base, lip, survey, sensor.
CommonErrors both_seen(double lip_mm, double survey_mm) {
  CommonErrors errors(variances({15, lip_mm, survey_mm, 10}));
  add(errors, vector({1, 0, -1, 1}));  // natural: base + sensor - survey
  add(errors, vector({0, -1, 0, 1}));  // dug: sensor - lip
  errors.solve();
  return errors;
}

TEST(CommonErrors, NaturalGroundTellsTheLip) {
  EXPECT_NEAR(sigma_mm(both_seen(20, 15), 1), 8.2416, 2e-4);
  EXPECT_NEAR(sigma_mm(both_seen(10, 15), 1), 6.7082, 2e-4);
  EXPECT_NEAR(sigma_mm(both_seen(30, 15), 1), 8.6603, 2e-4);
  const CommonErrors errors = both_seen(20, 15);
  const Vector measured = vector({1, 0, 0, 1}), dug = vector({1, 1, 0, 0}),
               natural = vector({0, 0, 1, 0});
  EXPECT_NEAR(height_mm(errors, measured, dug), 11.379, 2e-3);
  EXPECT_NEAR(height_mm(errors, measured, natural), 11.379, 2e-3);
  const auto of_dug = correct(errors, {0, kEndless, kExact}, measured, dug),
             of_natural = correct(errors, {0, kEndless, kExact}, measured, natural);
  const Vector between = of_dug.on - of_natural.on;
  EXPECT_NEAR(std::sqrt(between.dot(errors.covariance() * between)) / kMm, 0, 2e-4);
}

TEST(CommonErrors, ExactTerrainTellsTheLipBetter) {
  const CommonErrors errors = both_seen(20, 1e-6);
  EXPECT_NEAR(sigma_mm(errors, 1), 7.6822, 2e-4);
}

/// Against least squares over all unknowns at once: columns, what is alike in blocks, common
/// errors.
TEST(CommonErrors, EliminationIsExact) {
  std::mt19937 random(1);
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> uniform;
  constexpr int kBlocks = 8, kOfBlock = 5, kColumns = kBlocks * kOfBlock, kCommon = 3;
  const Vector prior = variances({15, 20, 10});
  const Eigen::Index all = kColumns + kBlocks + kCommon;
  Eigen::MatrixXd information = Eigen::MatrixXd::Zero(all, all);
  Vector sum = Vector::Zero(all);
  information.diagonal().segment(kColumns, kBlocks).setOnes();
  information.bottomRightCorner(kCommon, kCommon) = prior.cwiseInverse().asDiagonal();
  CommonErrors errors(prior);
  std::vector<ColumnResidual> columns;
  std::vector<Vector> measured, predicted;
  std::vector<BlockResidual> blocks(kBlocks);
  for (int n = 0; n < kBlocks; ++n) {
    Vector a(kCommon), b(kCommon);
    for (int k = 0; k < kCommon; ++k) {
      a[k] = normal(random);
      b[k] = normal(random);
    }
    measured.push_back(a);
    predicted.push_back(b);
    const auto sigma = [&] { return kMm * (5 + 15 * uniform(random)); };
    const double alike = sigma();
    for (int i = n * kOfBlock; i < (n + 1) * kOfBlock; ++i) {
      const double own = sigma();
      const ColumnResidual column{20 * kMm * normal(random), (1 + 30 * uniform(random)) * 1e3,
                                  own * own, alike};
      Vector row = Vector::Zero(all);
      row[i] = 1;
      row[kColumns + n] = alike;
      row.tail(kCommon) = b;
      information += row * row.transpose() / column.variance;
      row[kColumns + n] = 0;
      row.tail(kCommon) = a;
      information += column.weight * row * row.transpose();
      sum += column.weight * column.residual * row;
      blocks[static_cast<std::size_t>(n)].add(column, a - b, {i, 0});
      columns.push_back(column);
    }
    errors.add(blocks[static_cast<std::size_t>(n)]);
  }
  errors.solve();
  const Eigen::MatrixXd covariance = information.inverse();
  const Vector dense = covariance * sum;
  for (int k = 0; k < kCommon; ++k)
    EXPECT_NEAR(errors.mean()[k], dense[kColumns + kBlocks + k], 1e-12);
  double apart = 0;
  Vector on = Vector::Zero(kCommon);
  for (int n = 0; n < kBlocks; ++n) {
    const auto at = static_cast<std::size_t>(n);
    const BlockError block = blocks[at].error(kCommon);
    EXPECT_NEAR(errors.mean_of(block), dense[kColumns + n], 1e-9);
    double sum_alike = 0;
    for (int i = n * kOfBlock; i < (n + 1) * kOfBlock; ++i) {
      auto correction = correct(errors, columns[static_cast<std::size_t>(i)], measured[at],
                                predicted[at], blocks[at]);
      EXPECT_NEAR(correction.mean, dense[i], 1e-12);
      EXPECT_NEAR(errors.variance(correction, block), covariance(i, i), 1e-12);
      apart += correction.own;
      sum_alike += correction.alike;
      on += correction.on;
    }
    apart += sum_alike * sum_alike * block.variance;
    on += sum_alike * block.on;
  }
  EXPECT_NEAR(apart + on.dot(errors.covariance() * on),
              covariance.topLeftCorner(kColumns, kColumns).sum(), 1e-12);
}

/// A column that was not seen errs as its block does, and by itself.
TEST(CommonErrors, BlocksTellOfColumnsThatWereNotSeen) {
  CommonErrors errors(variances({1e-9}));
  BlockResidual block;
  const double alike = 6 * kMm, own = 4 * kMm, off = 9 * kMm;
  for (int i = 0; i < 10'000; ++i)
    block.add({off, kEndless, own * own, alike}, vector({0}), {i % 100, i / 100});
  auto unseen = correct(errors, {0, 0, own * own, alike}, vector({0}), vector({0}), block);
  EXPECT_NEAR(unseen.mean, off, 1e-3 * off);
  EXPECT_NEAR(std::sqrt(errors.variance(unseen, block.error(1))), own, 1e-3 * own);
  auto other = correct(errors, {0, 0, own * own, alike}, vector({0}), vector({0}));
  EXPECT_EQ(other.mean, 0);
  EXPECT_NEAR(std::sqrt(errors.variance(other, BlockResidual{}.error(1))), std::hypot(own, alike),
              1e-12);
}

/// So that a block that a trench or a view's edge cuts counts for less than a block.
TEST(CommonErrors, BlocksCountByTheirExtent) {
  const auto extent = [](int width, int height, int step) {
    BlockResidual block;
    for (int x = 0; x < width; x += step)
      for (int y = 0; y < height; y += step) block.add({0, 1, 1, 1}, vector({1}), {7 + x, 3 + y});
    return block.extent(40);
  };
  EXPECT_NEAR(extent(40, 40, 1), 1, 1e-12);
  EXPECT_NEAR(extent(40, 10, 1), 0.25, 1e-12);
  EXPECT_NEAR(extent(20, 20, 1), 0.25, 1e-12);
  EXPECT_NEAR(extent(1, 1, 1), 1.0 / 1600, 1e-12);
  EXPECT_NEAR(extent(40, 40, 8), 1, 0.05);  // as far apart as a lidar's rings
  BlockResidual block;
  block.add({0, kEndless, 0, 1}, vector({1}), {0, 0});
  for (const double variance : {1.0, 4.0}) {
    CommonErrors errors(vector({9}));
    errors.add(block, variance);
    errors.solve();
    EXPECT_NEAR(errors.covariance()(0, 0), 9 * variance / (9 + variance), 1e-9);
  }
}

}  // namespace
}  // namespace soilvdb
