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
  slicecorr_setup_free(setup);
  slicecorr_stack_free(stack);
  printf("slicecorr %s, interface %d\n", slicecorr_version(), slicecorr_abi_version());
  return 0;
}
