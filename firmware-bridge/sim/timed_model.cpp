// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "sim/timed_model.hpp"

#include <algorithm>

namespace slicecorr::bridge {

TimedModel::TimedModel(PrinterModel& model, const Pace& pace)
    : model_(model), pace_(pace), began_(std::chrono::steady_clock::now()) {}

void TimedModel::to_present() {
  if (pace_.lockstep) return;
  const std::chrono::duration<double> passed = std::chrono::steady_clock::now() - began_;
  model_.advance(passed.count() * pace_.rate);
}

void TimedModel::tell_new() {
  const auto& events = model_.events();
  for (; told_ < events.size(); ++told_) {
    if (tell_) tell_(events[told_]);
  }
}

void TimedModel::with(const std::function<void(PrinterModel&)>& use) {
  const std::lock_guard lock(mutex_);
  to_present();
  use(model_);
  tell_new();
}

void TimedModel::with_exchange(const std::function<void(PrinterModel&)>& use) {
  const std::lock_guard lock(mutex_);
  to_present();
  if (pace_.lockstep && !ticked_) {
    model_.advance(cycles_from_s_ + static_cast<double>(++exchanges_) * pace_.cycle_s);
  }
  use(model_);
  tell_new();
}

void TimedModel::with_at(double at_s, const std::function<void(PrinterModel&)>& use) {
  const std::lock_guard lock(mutex_);
  to_present();
  if (pace_.lockstep) model_.advance(at_s);
  use(model_);
  tell_new();
}

void TimedModel::tick(double at_s) {
  const std::lock_guard lock(mutex_);
  to_present();
  if (pace_.lockstep) {
    ticked_ = true;
    model_.advance(at_s);
  }
  tell_new();
}

void TimedModel::begin(double cycle_s) {
  const std::lock_guard lock(mutex_);
  pace_.cycle_s = cycle_s;
  count_exchanges();
}

void TimedModel::no_more_ticks() {
  const std::lock_guard lock(mutex_);
  count_exchanges();
}

void TimedModel::count_exchanges() {
  cycles_from_s_ = model_.now_s();
  exchanges_ = 0;
  ticked_ = false;
}

std::chrono::duration<double> TimedModel::real(double model_s) const {
  return std::chrono::duration<double>(model_s / pace_.rate);
}

void TimedModel::run_out() {
  const std::lock_guard lock(mutex_);
  to_present();
  constexpr double most_s = 60;
  const double until = model_.now_s() + most_s;
  if (const auto watchdog = model_.watchdog_at_s()) model_.advance(std::min(until, *watchdog));
  // Braking ends between two of these steps, each of which is exact.
  while (!(model_.lamps_dark() && model_.at_rest()) && model_.now_s() < until) {
    model_.advance(model_.now_s() + 0.01);
  }
  tell_new();
}

void TimedModel::on_event(std::function<void(const SimEvent&)> tell) {
  const std::lock_guard lock(mutex_);
  tell_ = std::move(tell);
}

}  // namespace slicecorr::bridge
