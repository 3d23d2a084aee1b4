/* A solar panel and an electronics box behind it, in a circular orbit; a proportional heater keeps the box warm.
 *
 * The orbit begins at time 0 with sunrise. The simulation begins twelve orbits before it, without payload, so that
 * nothing of its first temperatures is left. */

#include <math.h>
#include "model.h"

enum { LINK, ABSORPTIVITY, EMISSIVITY, CAPACITY, SHARE, PAYLOAD, PANEL, BOX, DUTY };

const char *const model_variables =
    "box.link parameter 0.8\n"
    "panel.absorptivity parameter 0.4\n"
    "panel.emissivity parameter 0.8\n"
    "box.capacity parameter 6000\n"
    "payload.share parameter 0.8\n"
    "payload.power input 0\n"
    "panel.temperature output 280\n"
    "box.temperature output 290\n"
    "heater.duty output 0\n";

static const double PERIOD = 5400.0, ECLIPSE = 0.38;              /* s; share of the orbit, at its end */
static const double SOLAR_CONSTANT = 1361.0, SIGMA = 5.670374419e-8; /* W m-2; W m-2 K-4 */
static const double AREA = 0.1, PANEL_CAPACITY = 2200.0;          /* m2; J/K */
static const double DISSIPATION = 6.0, HEATER_POWER = 15.0;       /* W */
static const double SET_POINT = 295.15, BAND = 4.0;               /* K */
static const double LONGEST_STEP = 20.0;                          /* s */

static double sunlight(double time) {
    double phase = fmod(time / PERIOD, 1.0), lit = 1.0 - ECLIPSE;
    if (phase < 0.0) phase += 1.0;
    return phase < lit ? SOLAR_CONSTANT * sin(M_PI * phase / lit) : 0.0;
}

static double duty(double box) { return fmin(1.0, fmax(0.0, (SET_POINT - box) / BAND)); }

static void rates(const double *v, double time, double panel, double box, double *panel_rate, double *box_rate) {
    double absorbed = AREA * v[ABSORPTIVITY] * sunlight(time);
    double emitted = AREA * v[EMISSIVITY] * SIGMA * panel * panel * panel * panel;
    double conducted = v[LINK] * (box - panel);
    *panel_rate = (absorbed - emitted + conducted) / PANEL_CAPACITY;
    *box_rate = (DISSIPATION + v[SHARE] * v[PAYLOAD] + HEATER_POWER * duty(box) - conducted) / v[CAPACITY];
}

/* Heun's method. */
static void advance(double *v, double time, double step) {
    double p1, b1, p2, b2;
    rates(v, time, v[PANEL], v[BOX], &p1, &b1);
    rates(v, time + step, v[PANEL] + step * p1, v[BOX] + step * b1, &p2, &b2);
    v[PANEL] += 0.5 * step * (p1 + p2);
    v[BOX] += 0.5 * step * (b1 + b2);
    v[DUTY] = duty(v[BOX]);
}

int model_step(double *v, double time, double step) {
    int count = (int)ceil(step / LONGEST_STEP - 1e-9);
    for (int k = 0; k < count; k++) advance(v, time + step * k / count, step / count);
    return 0;
}

void model_start(double *v) {
    double payload = v[PAYLOAD];
    v[PAYLOAD] = 0.0;
    v[PANEL] = 280.0;
    v[BOX] = 290.0;
    model_step(v, -12.0 * PERIOD, 12.0 * PERIOD);
    v[PAYLOAD] = payload;
}
