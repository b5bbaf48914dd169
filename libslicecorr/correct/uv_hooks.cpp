// Stands where the parts for UV light go: to be removed together with their arrival.

#include "correct/band_solvers.hpp"
#include "cure/walkers.hpp"
#include "slicecorr/error.hpp"

namespace slicecorr::detail {

namespace {
[[noreturn]] void not_here() { throw Error("doses under UV light are not part of this build"); }
}  // namespace

std::shared_ptr<const InhibitedKernel> make_inhibited_kernel(const Printer&, const Resin&,
                                                             const Process&, double) {
  not_here();
}
void check_inhibited_feasible(const CureModel&, const Printer&, const Process&) { not_here(); }
std::unique_ptr<BandDose::Walker> make_inhibited_walker(const CureModel&, std::size_t) {
  not_here();
}
std::unique_ptr<BandSolver> make_inhibited_solver(const CorrectionPlan&, std::size_t) {
  not_here();
}
std::vector<std::uint8_t> solve_inhibited_column(const CorrectionPlan&,
                                                 const std::vector<std::uint8_t>&) {
  not_here();
}
std::vector<double> solve_inhibited_column_exactly(const CorrectionPlan&,
                                                   const std::vector<std::uint8_t>&) {
  not_here();
}
int inhibited_slices(const CureModel&, int, int) { not_here(); }

}  // namespace slicecorr::detail

namespace slicecorr {

int InhibitedKernel::setting_of_slice(int) const { detail::not_here(); }
const double* InhibitedKernel::table(int, Place) const { detail::not_here(); }

}  // namespace slicecorr
