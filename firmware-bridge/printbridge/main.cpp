// The program `printbridge`.

#include "program/program.hpp"

int main() { return 2; }
