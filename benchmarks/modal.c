/* What one writes by hand: friend-2 as a scalar modal loop, zero-order hold, from rest.
 *
 * Two modes of the circuit, two of d(s), the beam's pair; how strongly the voltage drives a mode is
 * folded into its weights, so that a real mode costs one multiply-add. Four outputs per sample: current,
 * node voltage (from the current), displacement, force. Compiled on the spot by benchmarks/core.py with
 * -O3 -march=native -ffp-contract=fast, no -ffast-math.
 */
struct job {
    long n;
    const double *voltage;
    double *current, *node, *displacement, *force;
    double decay[4];                    /* x+ = decay x + u */
    double pair_real, pair_imag;        /* the beam's pole over one period: z+ = pair z + u */
    double current_weight[2], current_direct;
    double force_weight[4];
    double displacement_weight[4], pair_weight_real, pair_weight_imag;
    double series_resistance;
};

void modal(const struct job *restrict job)
{
    const double *restrict voltage = job->voltage;
    double *restrict current = job->current, *restrict node = job->node;
    double *restrict displacement = job->displacement, *restrict force = job->force;
    const double a0 = job->decay[0], a1 = job->decay[1], a2 = job->decay[2], a3 = job->decay[3];
    const double pr = job->pair_real, pi = job->pair_imag;
    const double i0 = job->current_weight[0], i1 = job->current_weight[1], id = job->current_direct;
    const double f0 = job->force_weight[0], f1 = job->force_weight[1];
    const double f2 = job->force_weight[2], f3 = job->force_weight[3];
    const double d0 = job->displacement_weight[0], d1 = job->displacement_weight[1];
    const double d2 = job->displacement_weight[2], d3 = job->displacement_weight[3];
    const double dr = job->pair_weight_real, di = job->pair_weight_imag;
    const double series = job->series_resistance;
    const long n = job->n;
    double x0 = 0.0, x1 = 0.0, x2 = 0.0, x3 = 0.0, zr = 0.0, zi = 0.0;
    for (long k = 0; k < n; k++) {
        const double u = voltage[k];
        const double i = i0 * x0 + i1 * x1 + id * u;
        current[k] = i;
        node[k] = u - series * i;
        force[k] = (f0 * x0 + f1 * x1) + (f2 * x2 + f3 * x3);
        displacement[k] = (d0 * x0 + d1 * x1) + (d2 * x2 + d3 * x3) + (dr * zr + di * zi);
        x0 = a0 * x0 + u;
        x1 = a1 * x1 + u;
        x2 = a2 * x2 + u;
        x3 = a3 * x3 + u;
        const double next = pr * zr - pi * zi + u;
        zi = pi * zr + pr * zi;
        zr = next;
    }
}
