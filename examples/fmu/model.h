/* What a model gives to fmi2.c and fmi3.c, which make it an FMU. */

/* A line for each variable: name, causality (parameter, input or output), start value. Its number is its reference. */
extern const char *const model_variables;

enum { MODEL_MOST_VARIABLES = 32 };

/* Called once the parameters are set: from them to the outputs at time 0. */
void model_start(double *values);

/* From one communication point to the next; inputs keep their values. Returns 0 (good), 2 (discard) or 3 (error). */
int model_step(double *values, double time, double step);
