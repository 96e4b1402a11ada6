/* What one writes by hand for many parameter sets: sixteen strips side by side in two vectors of eight doubles.
 *
 * The recursion of modal_loop.py: two modes of the circuit side by side, two chained pairs. `lanes` writes four outputs
 * of each strip, sixteen strips beside each other; `placed` puts the outputs of each strip behind each other, turning
 * squares of eight by eight numbers; `fused` writes none and keeps the sums of their squares. Compiled on the spot by
 * benchmarks/batch.py with -O3 -march=native -ffp-contract=fast, no -ffast-math.
 */
typedef double vector __attribute__((vector_size(64)));
enum { PAIR = 2, NUMBERS = 26 };

struct batch {
    long groups, n;
    const double *voltage;
    const vector *coefficients;         /* [group][number][PAIR] */
    vector *outputs;                    /* [group][row][output][PAIR] */
    vector *squares;                    /* [group][output][PAIR] */
    double *behind;                     /* [strip][output][row] */
};

#define ROWS(WRITE)                                                                                                   \
    for (long g = 0; g < batch->groups; g++) {                                                                        \
        const vector *c = batch->coefficients + g * NUMBERS * PAIR;                                                   \
        vector z1[PAIR] = {0}, z2[PAIR] = {0}, z3[PAIR] = {0}, z4[PAIR] = {0}, z5[PAIR] = {0}, z6[PAIR] = {0};       \
        vector s0[PAIR] = {0}, s1[PAIR] = {0}, s2[PAIR] = {0}, s3[PAIR] = {0};                                        \
        for (long k = 0; k < batch->n; k++) {                                                                         \
            const double u = batch->voltage[k];                                                                       \
            for (int i = 0; i < PAIR; i++) {                                                                          \
                const vector current = (C(8) * z1[i] + C(9) * z2[i]) + C(10) * u;                                     \
                const vector node = (C(11) * z1[i] + C(12) * z2[i]) + C(13) * u;                                      \
                const vector displacement = ((C(14) * z1[i] + C(15) * z2[i]) + (C(16) * z3[i] + C(17) * z4[i]))       \
                    + ((C(18) * z5[i] + C(19) * z6[i]) + C(20) * u);                                                  \
                const vector force = ((C(21) * z1[i] + C(22) * z2[i]) + (C(23) * z3[i] + C(24) * z4[i])) + C(25) * u; \
                WRITE                                                                                                 \
                z1[i] = C(0) * z1[i] + u;                                                                             \
                z2[i] = C(1) * z2[i] + u;                                                                             \
                const vector third = C(2) * z3[i] + (C(3) * z4[i] + u), fifth = C(5) * z5[i] + (C(6) * z6[i] + u);    \
                z4[i] = C(4) * z4[i] + z3[i];                                                                         \
                z6[i] = C(7) * z6[i] + z5[i];                                                                         \
                z3[i] = third;                                                                                        \
                z5[i] = fifth;                                                                                        \
            }                                                                                                         \
        }                                                                                                             \
        END                                                                                                           \
    }
#define C(j) c[(j) * PAIR + i]

void lanes(const struct batch *restrict batch)
{
#define END (void)s0, (void)s1, (void)s2, (void)s3;
    vector *restrict outputs = batch->outputs;
    ROWS({
        vector *restrict row = outputs + (g * batch->n + k) * 4 * PAIR + i;
        row[0] = current;
        row[PAIR] = node;
        row[2 * PAIR] = displacement;
        row[3 * PAIR] = force;
    })
#undef END
}

void fused(const struct batch *restrict batch)
{
    vector *restrict squares = batch->squares;
#define END                                                                                                           \
    for (int i = 0; i < PAIR; i++) {                                                                                  \
        squares[(g * 4 + 0) * PAIR + i] = s0[i];                                                                      \
        squares[(g * 4 + 1) * PAIR + i] = s1[i];                                                                      \
        squares[(g * 4 + 2) * PAIR + i] = s2[i];                                                                      \
        squares[(g * 4 + 3) * PAIR + i] = s3[i];                                                                      \
    }
    ROWS({
        s0[i] += current * current;
        s1[i] += node * node;
        s2[i] += displacement * displacement;
        s3[i] += force * force;
    })
#undef END
}

typedef long places __attribute__((vector_size(64)));
typedef double loose __attribute__((vector_size(64), aligned(8)));
enum { CHUNK = 128, EIGHT = 8 };

static inline void halves(vector *r, int half, places low, places high)
{
    for (int k = 0; k < EIGHT; k++)
        if (!(k & half)) {
            const vector a = r[k], b = r[k + half];
            r[k] = __builtin_shuffle(a, b, low);
            r[k + half] = __builtin_shuffle(a, b, high);
        }
}

static void spread(const vector made[CHUNK][4][PAIR], long rows, long group, long begin, const struct batch *batch)
{
    for (int o = 0; o < 4; o++)
        for (int i = 0; i < PAIR; i++)
            for (long t = 0; t < rows; t += EIGHT) { /* rows are a multiple of eight here */
                vector r[EIGHT];
                for (int k = 0; k < EIGHT; k++) r[k] = made[t + k][o][i];
                halves(r, 1, (places){0, 8, 2, 10, 4, 12, 6, 14}, (places){1, 9, 3, 11, 5, 13, 7, 15});
                halves(r, 2, (places){0, 1, 8, 9, 4, 5, 12, 13}, (places){2, 3, 10, 11, 6, 7, 14, 15});
                halves(r, 4, (places){0, 1, 2, 3, 8, 9, 10, 11}, (places){4, 5, 6, 7, 12, 13, 14, 15});
                double *to = batch->behind + ((group * PAIR * EIGHT + i * EIGHT) * 4 + o) * batch->n + begin + t;
                for (int k = 0; k < EIGHT; k++) *(loose *)(to + k * 4 * batch->n) = r[k];
            }
}

void placed(const struct batch *restrict batch)
{
#define END spread((const vector(*)[4][PAIR])made, batch->n % CHUNK, g, batch->n - batch->n % CHUNK, batch);              \
    (void)s0, (void)s1, (void)s2, (void)s3;
    vector made[CHUNK][4][PAIR];
    ROWS({
        vector *restrict row = &made[k % CHUNK][0][i];
        row[0] = current;
        row[PAIR] = node;
        row[2 * PAIR] = displacement;
        row[3 * PAIR] = force;
        if (i == PAIR - 1 && k % CHUNK == CHUNK - 1)
            spread((const vector(*)[4][PAIR])made, CHUNK, g, k - CHUNK + 1, batch);
    })
#undef END
}
