/* A model as a co-simulation FMU of FMI 2.0: the functions that a co-simulation calls; the others report an error. */

#include <stdlib.h>
#include <string.h>
#include "model.h"

enum { OK = 0, ERROR = 3 };

const char *fmi2GetTypesPlatform(void) { return "default"; }
const char *fmi2GetVersion(void) { return "2.0"; }

void *fmi2Instantiate(const char *name, int type, const char *guid, const char *resources, const void *callbacks,
                      int visible, int logging) {
    return calloc(MODEL_MOST_VARIABLES, sizeof(double));
}
void fmi2FreeInstance(void *instance) { free(instance); }

int fmi2SetupExperiment(void *instance, int has_tolerance, double tolerance, double start, int has_stop, double stop) {
    return OK;
}
int fmi2EnterInitializationMode(void *instance) { return OK; }
int fmi2ExitInitializationMode(void *instance) { model_start(instance); return OK; }
int fmi2Terminate(void *instance) { return OK; }
int fmi2Reset(void *instance) { memset(instance, 0, MODEL_MOST_VARIABLES * sizeof(double)); return OK; }

int fmi2GetReal(void *instance, const unsigned *references, size_t count, double *values) {
    for (size_t k = 0; k < count; k++) values[k] = ((double *)instance)[references[k]];
    return OK;
}
int fmi2SetReal(void *instance, const unsigned *references, size_t count, const double *values) {
    for (size_t k = 0; k < count; k++) ((double *)instance)[references[k]] = values[k];
    return OK;
}
int fmi2DoStep(void *instance, double time, double step, int no_going_back) { return model_step(instance, time, step); }

/* The standard wants all of its functions to be there; whoever calls one of these gets an error. */
#define ABSENT(name) int name(void) { return ERROR; }
ABSENT(fmi2CancelStep) ABSENT(fmi2DeSerializeFMUstate) ABSENT(fmi2FreeFMUstate) ABSENT(fmi2GetBoolean)
ABSENT(fmi2GetBooleanStatus) ABSENT(fmi2GetDirectionalDerivative) ABSENT(fmi2GetFMUstate) ABSENT(fmi2GetInteger)
ABSENT(fmi2GetIntegerStatus) ABSENT(fmi2GetRealOutputDerivatives) ABSENT(fmi2GetRealStatus) ABSENT(fmi2GetStatus)
ABSENT(fmi2GetString) ABSENT(fmi2GetStringStatus) ABSENT(fmi2SerializeFMUstate) ABSENT(fmi2SerializedFMUstateSize)
ABSENT(fmi2SetBoolean) ABSENT(fmi2SetDebugLogging) ABSENT(fmi2SetFMUstate) ABSENT(fmi2SetInteger)
ABSENT(fmi2SetRealInputDerivatives) ABSENT(fmi2SetString)
