// The program `slicefarm`: parses, calls the library and prints.

#include "commands.hpp"

int main(int argc, char** argv) {
  using namespace slicecorr;
  cli::Program program(
      "slicefarm",
      "Corrects many parts unattended: a durable queue, workers that may crash, results that are "
      "kept and checked.",
      "slicefarm submit *.stl --printer dual-wavelength-dlp --resin benchy-resin --layer-um 50 "
      "--speed-mm-h 800 --out corrected && slicefarm run --until-empty");
  farm::add_submit_commands(program);
  farm::add_run_commands(program);
  farm::add_status_commands(program);
  farm::add_follow_commands(program);
  farm::add_control_commands(program);
  return program.run(argc, argv);
}
