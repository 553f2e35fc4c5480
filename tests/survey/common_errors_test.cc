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

CommonErrors::Correction correct(const CommonErrors& errors, const ColumnResidual& column,
                                 const Vector& measured, const Vector& predicted) {
  CommonErrors::Correction made;
  errors.correct(column, measured, predicted, made);
  return made;
}

/// Sigma of a column's height after it was seen without end.
double height_mm(const CommonErrors& errors, const Vector& measured, const Vector& predicted) {
  const auto correction = correct(errors, {0, kEndless, kExact}, measured, predicted);
  return std::sqrt(correction.variance(errors)) / kMm;
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
  errors.add({0, kEndless, kExact}, measured - predicted);
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
  errors.add({0, kEndless, kExact}, vector({0, 1}) - vector({1, 0}));
  errors.solve();
  EXPECT_NEAR(sigma_mm(errors, 0), 8.9443, 5e-5);
}

/// Dug and natural ground are seen. Common errors: base, lip, survey, sensor.
CommonErrors both_seen(double lip_mm, double survey_mm) {
  CommonErrors errors(variances({15, lip_mm, survey_mm, 10}));
  errors.add({0, kEndless, kExact}, vector({1, 0, -1, 1}));  // natural: base + sensor - survey
  errors.add({0, kEndless, kExact}, vector({0, -1, 0, 1}));  // dug: sensor - lip
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

/// Against least squares over all unknowns at once.
TEST(CommonErrors, EliminationIsExact) {
  std::mt19937 random(1);
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> uniform;
  constexpr int kColumns = 40, kCommon = 3;
  const Vector prior = variances({15, 20, 10});
  const Eigen::Index all = kColumns + kCommon;
  Eigen::MatrixXd information = Eigen::MatrixXd::Zero(all, all);
  Vector sum = Vector::Zero(all);
  information.bottomRightCorner(kCommon, kCommon) = prior.cwiseInverse().asDiagonal();
  CommonErrors errors(prior);
  std::vector<ColumnResidual> columns;
  std::vector<Vector> measured, predicted;
  for (int i = 0; i < kColumns; ++i) {
    Vector a(kCommon), b(kCommon);
    for (int k = 0; k < kCommon; ++k) {
      a[k] = normal(random);
      b[k] = normal(random);
    }
    const double s = kMm * (5 + 15 * uniform(random));
    const ColumnResidual column{20 * kMm * normal(random), (1 + 30 * uniform(random)) * 1e3, s * s};
    Vector row = Vector::Zero(all);
    row[i] = 1;
    row.tail(kCommon) = b;
    information += row * row.transpose() / column.variance;
    row.tail(kCommon) = a;
    information += column.weight * row * row.transpose();
    sum += column.weight * column.residual * row;
    errors.add(column, a - b);
    columns.push_back(column);
    measured.push_back(a);
    predicted.push_back(b);
  }
  errors.solve();
  const Eigen::MatrixXd covariance = information.inverse();
  const Vector dense = covariance * sum;
  for (int k = 0; k < kCommon; ++k) EXPECT_NEAR(errors.mean()[k], dense[kColumns + k], 1e-12);
  double own = 0;
  Vector on = Vector::Zero(kCommon);
  for (int i = 0; i < kColumns; ++i) {
    const auto n = static_cast<std::size_t>(i);
    const auto correction = correct(errors, columns[n], measured[n], predicted[n]);
    EXPECT_NEAR(correction.mean, dense[i], 1e-12);
    EXPECT_NEAR(correction.variance(errors), covariance(i, i), 1e-12);
    own += correction.own;
    on += correction.on;
  }
  EXPECT_NEAR(own + on.dot(errors.covariance() * on),
              covariance.topLeftCorner(kColumns, kColumns).sum(), 1e-12);
}

}  // namespace
}  // namespace soilvdb
