// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/* Uses the installed C interface from outside: header, linking, version, a call that works and one that fails. */
#include <slicecorr.h>
#include <stdio.h>
#include <string.h>

int main(void) {
  static const unsigned char square[4] = {255, 255, 255, 255};
  slicecorr_grid grid = {sizeof grid, 2, 2, 2, 0, 50, 50, 50};
  slicecorr_stack* stack = NULL;
  slicecorr_setup* setup = slicecorr_setup_new();
  slicecorr_status status = slicecorr_stack_create(&grid, &stack);
  if (!status) status = slicecorr_stack_put(stack, 0, square, 2);
  if (!status) status = slicecorr_setup_set_text(setup, "no_such_setting", "1");
  if (status != SLICECORR_UNKNOWN_NAME || !strstr(slicecorr_error_text(), "no_such_setting")) {
    fprintf(stderr, "%d: %s\n", status, slicecorr_error_text());
    return 1;
  }
  /* One pixel of light that all of a 3 x 3 disc lies behind: the middle voxel gets it from 4 angles. */
  float light[4 * 3] = {0, 1, 0, 0, 1, 0, 0, 1, 0, 0, 1, 0}, dose[9];
  slicecorr_tomo_grid small = {sizeof small, 3, 1, 4, 0, 1.0, 0, 0.0};
  slicecorr_array from = {sizeof from, SLICECORR_FLOAT32, 0, light, {1, 4, 3}, {48, 12, 4}};
  slicecorr_array to = {sizeof to, SLICECORR_FLOAT32, 0, dose, {1, 3, 3}, {36, 12, 4}};
  slicecorr_tomo_bench* bench = NULL;
  status = slicecorr_tomo_bench_create(&small, NULL, &bench);
  if (!status) status = slicecorr_tomo_adjoint(bench, &from, &to, NULL);
  if (status || dose[4] != 4.0f) {
    fprintf(stderr, "%d: %s\n", status, slicecorr_error_text());
    return 1;
  }
  slicecorr_tomo_bench_free(bench);
  slicecorr_setup_free(setup);
  slicecorr_stack_free(stack);
  printf("slicecorr %s, interface %d\n", slicecorr_version(), slicecorr_abi_version());
  return 0;
}
