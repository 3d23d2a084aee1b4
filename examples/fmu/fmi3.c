/* A model as a co-simulation FMU of FMI 3.0: the functions that a co-simulation calls; the others report an error. */

#include <stdbool.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include "model.h"

enum { OK = 0, ERROR = 3 };
typedef struct { double values[MODEL_MOST_VARIABLES]; bool ended; } Instance;

const char *fmi3GetVersion(void) { return "3.0"; }

void *fmi3InstantiateCoSimulation(const char *name, const char *token, const char *resources, bool visible, bool logging,
                                  bool events, bool early, const uint32_t *wanted, size_t count, void *environment,
                                  void *log, void *update) {
    return calloc(1, sizeof(Instance));
}
void fmi3FreeInstance(void *instance) { free(instance); }

int fmi3EnterInitializationMode(void *instance, bool has_tolerance, double tolerance, double start, bool has_stop,
                                double stop) { return OK; }
int fmi3ExitInitializationMode(void *instance) { model_start(((Instance *)instance)->values); return OK; }
int fmi3Terminate(void *instance) { return OK; }
int fmi3Reset(void *instance) { memset(instance, 0, sizeof(Instance)); return OK; }

int fmi3GetFloat64(void *instance, const uint32_t *references, size_t count, double *values, size_t value_count) {
    for (size_t k = 0; k < count; k++) values[k] = ((Instance *)instance)->values[references[k]];
    return OK;
}
int fmi3SetFloat64(void *instance, const uint32_t *references, size_t count, const double *values, size_t value_count) {
    for (size_t k = 0; k < count; k++) ((Instance *)instance)->values[references[k]] = values[k];
    return OK;
}
int fmi3DoStep(void *instance, double time, double step, bool no_going_back, bool *event, bool *terminate, bool *early,
               double *reached) {
    int status = model_step(((Instance *)instance)->values, time, step);
    *event = *early = false;
    *terminate = status == 1; /* a model's way to end the simulation */
    *reached = time + step;
    return status == 1 ? OK : status;
}

/* The standard wants all of its functions to be there; whoever calls one of these gets an error. */
#define ABSENT(name) int name(void) { return ERROR; }
ABSENT(fmi3ActivateModelPartition) ABSENT(fmi3CompletedIntegratorStep) ABSENT(fmi3DeserializeFMUState)
ABSENT(fmi3EnterConfigurationMode) ABSENT(fmi3EnterContinuousTimeMode) ABSENT(fmi3EnterEventMode)
ABSENT(fmi3EnterStepMode) ABSENT(fmi3EvaluateDiscreteStates) ABSENT(fmi3ExitConfigurationMode)
ABSENT(fmi3FreeFMUState) ABSENT(fmi3GetAdjointDerivative) ABSENT(fmi3GetBinary) ABSENT(fmi3GetBoolean)
ABSENT(fmi3GetClock) ABSENT(fmi3GetContinuousStateDerivatives) ABSENT(fmi3GetContinuousStates)
ABSENT(fmi3GetDirectionalDerivative) ABSENT(fmi3GetEventIndicators) ABSENT(fmi3GetFMUState) ABSENT(fmi3GetFloat32)
ABSENT(fmi3GetInt16) ABSENT(fmi3GetInt32) ABSENT(fmi3GetInt64) ABSENT(fmi3GetInt8) ABSENT(fmi3GetIntervalDecimal)
ABSENT(fmi3GetIntervalFraction) ABSENT(fmi3GetNominalsOfContinuousStates) ABSENT(fmi3GetNumberOfContinuousStates)
ABSENT(fmi3GetNumberOfEventIndicators) ABSENT(fmi3GetNumberOfVariableDependencies) ABSENT(fmi3GetOutputDerivatives)
ABSENT(fmi3GetShiftDecimal) ABSENT(fmi3GetShiftFraction) ABSENT(fmi3GetString) ABSENT(fmi3GetUInt16)
ABSENT(fmi3GetUInt32) ABSENT(fmi3GetUInt64) ABSENT(fmi3GetUInt8) ABSENT(fmi3GetVariableDependencies)
ABSENT(fmi3SerializeFMUState) ABSENT(fmi3SerializedFMUStateSize) ABSENT(fmi3SetBinary) ABSENT(fmi3SetBoolean)
ABSENT(fmi3SetClock) ABSENT(fmi3SetContinuousStates) ABSENT(fmi3SetDebugLogging) ABSENT(fmi3SetFMUState)
ABSENT(fmi3SetFloat32) ABSENT(fmi3SetInt16) ABSENT(fmi3SetInt32) ABSENT(fmi3SetInt64) ABSENT(fmi3SetInt8)
ABSENT(fmi3SetIntervalDecimal) ABSENT(fmi3SetIntervalFraction) ABSENT(fmi3SetShiftDecimal) ABSENT(fmi3SetShiftFraction)
ABSENT(fmi3SetString) ABSENT(fmi3SetTime) ABSENT(fmi3SetUInt16) ABSENT(fmi3SetUInt32) ABSENT(fmi3SetUInt64)
ABSENT(fmi3SetUInt8) ABSENT(fmi3UpdateDiscreteStates)

void *fmi3InstantiateModelExchange(void) { return NULL; }
void *fmi3InstantiateScheduledExecution(void) { return NULL; }
