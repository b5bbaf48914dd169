/* Corrects an archive: correct IN OUT PRINTER RESIN SPEED_MM_H. IN and OUT may be the same file. */
#include <slicecorr.h>
#include <stdio.h>

static int show(void* user, const char* stage, double fraction) {
  (void)user;
  fprintf(stderr, "%s %.0f %%\n", stage, 100 * fraction);
  return 0; /* anything else cancels */
}

int main(int argc, char** argv) {
  if (argc != 6) return SLICECORR_BAD_INPUT;
  slicecorr_setup* setup = slicecorr_setup_new();
  slicecorr_job* job = slicecorr_job_new();
  slicecorr_stack* stack = NULL;
  slicecorr_figures *after = NULL, *before = NULL;
  slicecorr_status status = slicecorr_stack_open(argv[1], &stack);
  if (!status) status = slicecorr_setup_set_text(setup, "printer", argv[3]);
  if (!status) status = slicecorr_setup_set_text(setup, "resin", argv[4]);
  if (!status) status = slicecorr_setup_set_text(setup, "speed_mm_h", argv[5]);
  if (!status) status = slicecorr_job_set_progress(job, show, NULL);
  if (!status) status = slicecorr_correct(stack, setup, argv[2], job, &after, &before);
  slicecorr_summary a = {.struct_size = sizeof a}, b = {.struct_size = sizeof b};
  if (!status) status = slicecorr_figures_summary(after, &a);
  if (!status) status = slicecorr_figures_summary(before, &b);
  if (status) {
    fprintf(stderr, "correct: %s\n", slicecorr_error_text());
  } else {
    printf("mean height error %.2f um, without correction %.2f um\n", a.mean_abs_height_error_um,
           b.mean_abs_height_error_um);
  }
  slicecorr_figures_free(before);
  slicecorr_figures_free(after);
  slicecorr_stack_free(stack);
  slicecorr_job_free(job);
  slicecorr_setup_free(setup);
  return status;
}
