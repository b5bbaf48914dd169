// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/* dlopen LIBRARY TARGET SETUP_TOML... : loads the library, corrects with several threads, unloads it,
 * again and again, also from a thread that ends after the library is unloaded. */
#include <dlfcn.h>
#include <pthread.h>
#include <slicecorr.h>
#include <stdio.h>

static char** arguments;

#define LOAD(name) __typeof__(&name) p_##name = (__typeof__(&name))dlsym(library, #name)

/* 0 when all went well. */
static int round_trip(void) {
  void* library = dlopen(arguments[1], RTLD_NOW | RTLD_LOCAL);
  if (!library) {
    fprintf(stderr, "%s\n", dlerror());
    return 1;
  }
  LOAD(slicecorr_setup_new);
  LOAD(slicecorr_setup_set_text);
  LOAD(slicecorr_setup_free);
  LOAD(slicecorr_job_new);
  LOAD(slicecorr_job_set_threads);
  LOAD(slicecorr_job_free);
  LOAD(slicecorr_stack_open);
  LOAD(slicecorr_stack_free);
  LOAD(slicecorr_correct_in_memory);
  LOAD(slicecorr_error_text);
  slicecorr_setup* setup = p_slicecorr_setup_new();
  slicecorr_job* job = p_slicecorr_job_new();
  slicecorr_stack *target = NULL, *corrected = NULL, *none = NULL;
  int bad = p_slicecorr_job_set_threads(job, 4);
  bad = bad || p_slicecorr_setup_set_text(setup, "printer", arguments[3]);
  bad = bad || p_slicecorr_setup_set_text(setup, "resin", arguments[4]);
  bad = bad || p_slicecorr_setup_set_text(setup, "speed_mm_h", arguments[5]);
  bad = bad || p_slicecorr_stack_open(arguments[2], &target);
  bad = bad || p_slicecorr_correct_in_memory(target, setup, job, &corrected, NULL);
  if (bad) fprintf(stderr, "%s\n", p_slicecorr_error_text());
  /* Leaves a text behind in this thread. */
  bad = bad || p_slicecorr_stack_open("/no/such/file/of/a/long/name.uvj", &none) == SLICECORR_OK;
  p_slicecorr_stack_free(corrected);
  p_slicecorr_stack_free(target);
  p_slicecorr_job_free(job);
  p_slicecorr_setup_free(setup);
  return dlclose(library) != 0 || bad;
}

static void* in_thread(void* result) {
  *(int*)result = round_trip();
  return NULL;
}

int main(int argc, char** argv) {
  if (argc != 6) return 2;
  arguments = argv;
  for (int i = 0; i < 3; ++i) {
    if (round_trip()) return 1;
    pthread_t thread;
    int result = 1;
    if (pthread_create(&thread, NULL, in_thread, &result) != 0) return 3;
    pthread_join(thread, NULL);
    if (result) return 1;
  }
  puts("done");
  return 0;
}
