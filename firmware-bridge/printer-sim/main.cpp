// The program `printer-sim`.

#include "program/program.hpp"

int main() { return 2; }
