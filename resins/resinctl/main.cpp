// The program `resinctl`: keeps and fits the resin database.

#include "commands.hpp"

int main(int argc, char** argv) {
  using namespace slicecorr;
  cli::Program program("resinctl",
                       "Keeps the database of resins and printers, and fits cure models to "
                       "measurements.",
                       "resinctl fit heights.csv --model kinetic --json - -o my-resin.toml");
  resinctl::add_database(program);
  resinctl::add_fit(program);
  resinctl::add_derive(program);
  resinctl::add_optics(program);
  resinctl::add_spread(program);
  resinctl::add_tune(program);
  resinctl::add_plot(program);
  resinctl::add_design(program);
  resinctl::add_chemistry(program);
  return program.run(argc, argv);
}
