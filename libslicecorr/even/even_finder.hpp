// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// The search for light that makes the dead zone even (even_dead_zone.hpp): slice by slice, for what images
/// will show of it, until it is nowhere worse than light that is the same everywhere.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "even/even_cells.hpp"
#include "even/kept_images.hpp"
#include "even/planned_images.hpp"
#include "slicecorr/setup.hpp"

namespace slicecorr::detail {

/// One search. For one thread; `target`, `setup` and `context` must outlive it.
class EvenFinder {
 public:
  /// `every`: slices 0, every, 2 every ... and the last are looked at, and more where sections change.
  /// `hold_off`: every cell's curing light is to be at most this share of what its UV light holds off the
  /// window; > 0.
  EvenFinder(const SliceSource& target, const Setup& setup, const ExecutionContext& context,
             int every, double hold_off);
  /// The process with light for images that are guessed, which takes no solve: a first step of `find`.
  Process guess();
  /// The process of the setup with its light; `process`: what `guess` gave.
  Process find(Process process);
  /// What `correct_stack` leaves unprinted with the process that `find` gave, where the gap was left open and the whole
  /// part was solved with it in any case; else nothing.
  const std::optional<Undercured>& undercured() const { return undercured_; }
  /// Tells gap, slices and caps through the context.
  void tell(const Process& process) const;

 private:
  /// Light of a section, cells beside it among it.
  struct SectionLight {
    SectionOptimum best;
    double mean_uv_mw_cm2 = 0;  ///< over the section
  };
  using SharedLight = std::shared_ptr<const SectionLight>;
  /// How the light of a slice was found.
  enum class How {
    roughly,   ///< in a few steps, for images that were guessed
    sought,    ///< for images as they come out
    constant,  ///< the same everywhere: a pattern does no better
  };
  /// Light that is found, slice by slice.
  struct Found {
    std::vector<int> slices;
    std::vector<SharedLight> lights;
    std::vector<How> how;
    std::vector<std::size_t> tries;  ///< for images as they came out
  };
  /// What is to be done to a slice: its light is sought so, for this image.
  struct Task {
    int slice = 0;
    How how = How::sought;
    std::size_t tries = 0;  ///< before
    std::shared_ptr<const ImageLight> image;
    SharedLight start;  ///< light that is nearly right; null: none is
  };
  /// What a look at the slices that are judged found.
  struct Look {
    bool sought = false;  ///< some slices have new light since
    std::vector<int>
        sticks;  ///< slices in which resin sticks where with constant light it does not; rising
  };

  bool patterned() const { return setup_.printer.uv->patterned; }
  Setup planned(const Process& process) const {
    return {setup_.printer, setup_.resin, process, setup_.gap_um};
  }
  EvenSections::Cells cells() const { return {goal_.min_gap_um, design_.part().grid().pitch_um}; }

  Found starting_light(const std::vector<int>& slices);
  void set_most_slices(const std::vector<int>& first);
  Found guessed_light(const Setup& setup);
  Look mend(const Setup& setup, int round);
  std::optional<How> next_try(const FlowDoses::Slice& judged, int round, std::size_t& room) const;
  std::size_t tries_of(int slice) const;
  std::vector<int> sticking(const Setup& setup);
  Found with_constant(const std::vector<int>& slices, const Setup& setup) const;
  SharedLight light_near(int slice) const;
  std::vector<SharedLight> seek(const EvenSections& sections, const std::vector<Task>& tasks,
                                const char* stage) const;
  static std::string key_of(std::size_t mask, const Task& task);
  std::vector<int> chosen_slices(const EvenSections& sections) const;
  static SharedLight light_of(const FlowSection& section, const ImageLight* image,
                              SectionOptimum optimum);

  Process process_of(Found found);
  EvenLight light() const;
  std::shared_ptr<const std::vector<std::uint8_t>> uv_bytes() const;
  template <class CellsOf, class ByteOf>
  std::shared_ptr<const std::vector<std::uint8_t>> bytes(const CellsOf& cells_of,
                                                         const ByteOf& byte_of) const;
  UvSchedule schedule() const;

  /// Share of its greatest light by which a UV lamp may change from slice to slice.
  static constexpr double kLampStep = 0.02;

  const SliceSource& target_;
  const WholeTarget whole_;  ///< with what is left alone
  const Setup& setup_;
  const ExecutionContext& context_;
  const ExecutionContext alone_;
  int every_;
  double hold_off_;
  EvenSections design_;  ///< all that is part, dark or not
  SectionGoal goal_;
  Found found_;
  std::size_t most_slices_ = 0;  ///< whose light is sought
  int rounds_ = 0;               ///< of a look at what comes out, at most
  bool gap_at_limit_ = false;
  std::size_t given_up_ =
      0;  ///< slices in which resin stuck when patterns were given up; 0: they were not
  std::optional<Undercured> undercured_;
};

}  // namespace slicecorr::detail
