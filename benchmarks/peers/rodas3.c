/* The scheme of flightcal.simulator.step, as a C programmer would write it: RODAS3 on a sparse pattern, thermostats
 * located inside the step by a safeguarded Newton iteration on the step's length. Forward only.
 * Its own code; the equations are in docs/numerics.md and Sandu et al. (1997), Atmos. Environ. 31, 3459-3472. */
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

typedef int64_t I;

typedef struct {
    I n, heaters, steps, inputs, forcings, heatings;
    const double *mass;
    const I *a_start, *a_col, *a_slot, *n_start, *n_col, *n_slot, *f_start, *f_col, *f_diag;
    const I *b_row, *b_col, *g_heater, *g_row, *sensor;
    const double *A, *N, *B, *g, *lower, *upper, *x0, *times, *w, *on0;
} Problem;

typedef struct {
    double *W, *row, *k1, *k2, *k3, *k4, *f0, *f1, *f2, *x2, *x3, *x1, *b0, *b1, *slope, *d1, *d2, *d3, *d4, *v;
} Work;

static void factor(const Problem *p, double *restrict W, double *restrict row)
{
    for (I i = 0; i < p->n; i++) {
        const I begin = p->f_start[i], end = p->f_start[i + 1], diagonal = p->f_diag[i];
        for (I q = begin; q < end; q++) row[p->f_col[q]] = W[q];
        for (I q = begin; q < diagonal; q++) {
            const I k = p->f_col[q], d = p->f_diag[k];
            const double l = row[k] *= W[d];
            for (I r = d + 1; r < p->f_start[k + 1]; r++) row[p->f_col[r]] -= l * W[r];
        }
        for (I q = begin; q < end; q++) W[q] = row[p->f_col[q]];
        W[diagonal] = 1.0 / W[diagonal];
    }
}

static void solve(const Problem *p, const double *restrict W, double *restrict r)
{
    for (I i = 0; i < p->n; i++) {
        double sum = r[i];
        for (I q = p->f_start[i]; q < p->f_diag[i]; q++) sum -= W[q] * r[p->f_col[q]];
        r[i] = sum;
    }
    for (I i = p->n - 1; i >= 0; i--) {
        double sum = r[i];
        for (I q = p->f_diag[i] + 1; q < p->f_start[i + 1]; q++) sum -= W[q] * r[p->f_col[q]];
        r[i] = sum * W[p->f_diag[i]];
    }
}

static void rate(const Problem *p, const double *restrict x, const double *restrict b, double *restrict f)
{
    for (I i = 0; i < p->n; i++) {
        double sum = b[i];
        for (I q = p->a_start[i]; q < p->a_start[i + 1]; q++) sum += p->A[q] * x[p->a_col[q]];
        for (I q = p->n_start[i]; q < p->n_start[i + 1]; q++) {
            const double t = x[p->n_col[q]], t2 = t * t;
            sum += p->N[q] * t2 * t2;
        }
        f[i] = sum;
    }
}

/* out = J(x) v */
static void jacobian_times(const Problem *p, const double *restrict x, const double *restrict v, double *restrict out)
{
    for (I i = 0; i < p->n; i++) {
        double sum = 0.0;
        for (I q = p->a_start[i]; q < p->a_start[i + 1]; q++) sum += p->A[q] * v[p->a_col[q]];
        for (I q = p->n_start[i]; q < p->n_start[i + 1]; q++) {
            const double t = x[p->n_col[q]];
            sum += p->N[q] * 4.0 * t * t * t * v[p->n_col[q]];
        }
        out[i] = sum;
    }
}

static void step(const Problem *p, Work *s, const double *x, double h)
{
    const I n = p->n;
    const double half = 0.5 * h;
    memset(s->W, 0, sizeof(double) * p->f_start[n]);
    for (I q = 0; q < p->a_start[n]; q++) s->W[p->a_slot[q]] = -half * p->A[q];
    for (I q = 0; q < p->n_start[n]; q++) {
        const double t = x[p->n_col[q]];
        s->W[p->n_slot[q]] -= half * p->N[q] * 4.0 * t * t * t;
    }
    for (I i = 0; i < n; i++) s->W[p->f_diag[i]] += p->mass[i];
    factor(p, s->W, s->row);
    rate(p, x, s->b0, s->f0);
    for (I i = 0; i < n; i++) s->k1[i] = half * (s->f0[i] + 0.5 * (s->b1[i] - s->b0[i]));
    solve(p, s->W, s->k1);
    for (I i = 0; i < n; i++) {
        s->k2[i] = half * (s->f0[i] + 1.5 * (s->b1[i] - s->b0[i])) + 2.0 * p->mass[i] * s->k1[i];
        s->x2[i] = x[i] + 2.0 * s->k1[i];
    }
    solve(p, s->W, s->k2);
    rate(p, s->x2, s->b1, s->f1);
    for (I i = 0; i < n; i++) s->k3[i] = half * s->f1[i] + 0.5 * p->mass[i] * (s->k1[i] - s->k2[i]);
    solve(p, s->W, s->k3);
    for (I i = 0; i < n; i++) s->x3[i] = s->x2[i] + s->k3[i];
    rate(p, s->x3, s->b1, s->f2);
    for (I i = 0; i < n; i++)
        s->k4[i] = half * s->f2[i] + 0.5 * p->mass[i] * (s->k1[i] - s->k2[i] - 8.0 / 3.0 * s->k3[i]);
    solve(p, s->W, s->k4);
    for (I i = 0; i < n; i++) s->x1[i] = s->x3[i] + s->k4[i];
}

/* v = d x1 / d h of the step just made from x. */
static void step_derivative(const Problem *p, Work *s, const double *x, double h)
{
    const I n = p->n;
    const double half = 0.5 * h;
    jacobian_times(p, x, s->k1, s->d1);
    for (I i = 0; i < n; i++)
        s->d1[i] = 0.5 * (s->d1[i] + s->f0[i] + 0.5 * (s->b1[i] - s->b0[i])) + half * 0.5 * s->slope[i];
    solve(p, s->W, s->d1);
    jacobian_times(p, x, s->k2, s->d2);
    for (I i = 0; i < n; i++)
        s->d2[i] = 0.5 * (s->d2[i] + s->f0[i] + 1.5 * (s->b1[i] - s->b0[i])) + half * 1.5 * s->slope[i]
                   + 2.0 * p->mass[i] * s->d1[i];
    solve(p, s->W, s->d2);
    for (I i = 0; i < n; i++) s->v[i] = 2.0 * s->d1[i];
    jacobian_times(p, s->x2, s->v, s->row);
    jacobian_times(p, x, s->k3, s->d3);
    for (I i = 0; i < n; i++)
        s->d3[i] = 0.5 * (s->d3[i] + s->f1[i] + p->mass[i] * (s->d1[i] - s->d2[i])) + half * (s->row[i] + s->slope[i]);
    solve(p, s->W, s->d3);
    for (I i = 0; i < n; i++) s->v[i] += s->d3[i];
    jacobian_times(p, s->x3, s->v, s->row);
    jacobian_times(p, x, s->k4, s->d4);
    for (I i = 0; i < n; i++)
        s->d4[i] = 0.5 * (s->d4[i] + s->f2[i] + p->mass[i] * (s->d1[i] - s->d2[i] - 8.0 / 3.0 * s->d3[i]))
                   + half * (s->row[i] + s->slope[i]);
    solve(p, s->W, s->d4);
    for (I i = 0; i < n; i++) s->v[i] += s->d4[i];
}

static void heat(const Problem *p, const double *w, double *b)
{
    memset(b, 0, sizeof(double) * p->n);
    for (I q = 0; q < p->forcings; q++) b[p->b_row[q]] += p->B[q] * w[p->b_col[q]];
}

/* Length of the step from x at which heater k's sensor meets its threshold; x1 is past it at length h. */
static double locate(const Problem *p, Work *s, const double *x, double h, I sensor, double sign, double threshold)
{
    const double before = sign * (x[sensor] - threshold), end = sign * (s->x1[sensor] - threshold);
    double low = 0.0, high = h, length = before < 0.0 ? h * before / (before - end) : 0.0;
    for (int iteration = 0; iteration < 40; iteration++) {
        for (I i = 0; i < p->n; i++) s->b1[i] = s->b0[i] + s->slope[i] * length;
        step(p, s, x, length);
        const double value = sign * (s->x1[sensor] - threshold);
        if (fabs(value) < 1e-11 || high - low < 1e-12 * h) break;
        step_derivative(p, s, x, length);
        if (value > 0.0) high = length; else low = length;
        length -= value / (sign * s->v[sensor]);
        if (!(low < length && length < high)) length = 0.5 * (low + high);
    }
    return length;
}

/* Fills states [steps+1, n]; returns the number of switches, -1 where memory is short. */
I simulate(const Problem *p, double *states)
{
    const I n = p->n, H = p->heaters;
    double *memory = malloc(sizeof(double) * (p->f_start[n] + 22 * n + 2 * H));
    if (!memory) return -1;
    Work s;
    double *next = memory;
    s.W = next, next += p->f_start[n];
    double **vectors[] = {&s.row, &s.k1, &s.k2, &s.k3, &s.k4, &s.f0, &s.f1, &s.f2, &s.x2, &s.x3,
                          &s.x1, &s.b0, &s.b1, &s.slope, &s.d1, &s.d2, &s.d3, &s.d4, &s.v};
    for (size_t k = 0; k < sizeof vectors / sizeof *vectors; k++) *vectors[k] = next, next += n;
    double *x = next, *left = x + n, *right = left + n, *u = right + n;
    I switches = 0;
    memcpy(x, p->x0, sizeof(double) * n);
    memcpy(states, x, sizeof(double) * n);
    for (I k = 0; k < H; k++) {
        const double t = x[p->sensor[k]];
        u[k] = t < p->lower[k] ? 1.0 : t > p->upper[k] ? 0.0 : p->on0[k];
    }
    heat(p, p->w, right);
    for (I j = 0; j < p->steps; j++) {
        const double duration = p->times[j + 1] - p->times[j];
        memcpy(left, right, sizeof(double) * n);
        heat(p, p->w + (j + 1) * p->inputs, right);
        double begin = 0.0;
        while (begin < duration) {
            const double h = duration - begin;
            for (I i = 0; i < n; i++) {
                s.slope[i] = (right[i] - left[i]) / duration;
                s.b0[i] = left[i] + s.slope[i] * begin;
            }
            for (I q = 0; q < p->heatings; q++) s.b0[p->g_row[q]] += u[p->g_heater[q]] * p->g[q];
            for (I i = 0; i < n; i++) s.b1[i] = s.b0[i] + s.slope[i] * h;
            step(p, &s, x, h);
            I event = -1, crossed = 0;
            double tau = h;
            for (I k = 0; k < H; k++) {
                const double sign = u[k] > 0.5 ? 1.0 : -1.0, threshold = u[k] > 0.5 ? p->upper[k] : p->lower[k];
                if (crossed) { /* another heater's search has left the step's end */
                    for (I i = 0; i < n; i++) s.b1[i] = s.b0[i] + s.slope[i] * h;
                    step(p, &s, x, h);
                    crossed = 0;
                }
                if (sign * (s.x1[p->sensor[k]] - threshold) <= 0.0) continue;
                const double length = locate(p, &s, x, h, p->sensor[k], sign, threshold);
                crossed = 1;
                if (length < tau) tau = length, event = k;
            }
            if (event >= 0) {
                for (I i = 0; i < n; i++) s.b1[i] = s.b0[i] + s.slope[i] * tau;
                step(p, &s, x, tau);
                u[event] = 1.0 - u[event];
                switches++;
                begin += tau;
            } else {
                begin = duration;
            }
            memcpy(x, s.x1, sizeof(double) * n);
        }
        memcpy(states + (j + 1) * n, x, sizeof(double) * n);
    }
    free(memory);
    return switches;
}
