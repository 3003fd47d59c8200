/* A learned skill read by a program that knows nothing of this project: means and covariances are enough.
 *
 *     cc -O2 -o skill_path skill_path.c -lm
 *     opcua-skill skills export SKILL --format json -o skill.json
 *     ./skill_path skill.json 1000 > path.csv
 *
 * prints phase, time and position (SI units), and the tool's orientation if it was learned, at even phases of the path.
 * Equations: docs/reference/learning/model.md.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* Return what stands after "key": in the outermost object of the text, or stop. */
static const char *value_of(const char *text, const char *key) {
    size_t length = strlen(key);
    int depth = 0;
    for (; *text; text++) {
        if (*text == '{' || *text == '[') depth++;
        if (*text == '}' || *text == ']') depth--;
        if (*text != '"') continue;
        const char *start = ++text;
        for (; *text && *text != '"'; text++)
            if (*text == '\\' && text[1]) text++;
        if (!*text) break;
        const char *colon = text + 1 + strspn(text + 1, " \t\r\n");
        if (depth == 1 && *colon == ':' && (size_t)(text - start) == length && !strncmp(start, key, length)) return colon + 1;
    }
    fprintf(stderr, "the file has no key \"%s\"\n", key);
    exit(1);
}

/* Read the numbers of a nested list in order; return how many, and in *rows how many lists are directly inside the outer one. */
static long numbers(const char *text, double **values, long *rows) {
    long count = 0, room = 0;
    int depth = 0;
    *rows = 0;
    *values = NULL;
    for (; *text; text++) {
        if (*text == '[') {
            if (++depth == 2) (*rows)++;
        } else if (*text == ']') {
            if (--depth == 0) break;
        } else if (strchr("-0123456789", *text)) {
            char *end;
            if (count == room) *values = realloc(*values, (size_t)(room = room ? 2 * room : 64) * sizeof **values);
            if (!*values) exit(1);
            (*values)[count++] = strtod(text, &end);
            text = end - 1;
        }
    }
    return count;
}

int main(int argc, char **argv) {
    if (argc != 3) {
        fprintf(stderr, "usage: %s skill.json POINTS\n", argv[0]);
        return 2;
    }
    FILE *file = fopen(argv[1], "rb");
    if (!file) {
        perror(argv[1]);
        return 1;
    }
    fseek(file, 0, SEEK_END);
    long size = ftell(file);
    rewind(file);
    char *text = malloc((size_t)size + 1);
    if (!text || fread(text, 1, (size_t)size, file) != (size_t)size) return 1;
    text[size] = 0;
    fclose(file);

    double *means, *covariances;
    long components, unused;
    long count = numbers(value_of(text, "means"), &means, &components);
    numbers(value_of(text, "covariances"), &covariances, &unused);
    long width = count / components; /* columns: clock, then outputs */
    long dimension = strtol(value_of(text, "dimension"), NULL, 10);
    double duration = strtod(value_of(text, "duration"), NULL);
    const char *word = strchr(value_of(text, "clock"), '"') + 1;
    int over_path = strncmp(word, "path", 4) == 0; /* else over time in seconds */
    long first = over_path ? 2 : 1;                /* first position column */
    long points = strtol(argv[2], NULL, 10);
    double *weight = malloc((size_t)components * sizeof *weight);
    if (!weight || points < 2 || width > 16) return 1;

    printf("phase,t_s,x_m,y_m%s%s\n", dimension == 3 ? ",z_m" : "", width > first + dimension ? ",qx,qy,qz,qw" : "");
    for (long i = 0; i < points; i++) {
        double phase = (double)i / (double)(points - 1), clock = over_path ? phase : phase * duration;
        double nearest = INFINITY, total = 0;
        /* Activation h_k: the prior is tied, w_k = sqrt(S_11,k) / sum, and cancels against the density's own factor. */
        for (long k = 0; k < components; k++) {
            const double *mean = means + k * width, *cover = covariances + k * width * width;
            weight[k] = 0.5 * (clock - mean[0]) * (clock - mean[0]) / cover[0];
            if (weight[k] < nearest) nearest = weight[k];
        }
        for (long k = 0; k < components; k++) total += weight[k] = exp(nearest - weight[k]);
        double output[16] = {clock}; /* column 0 is the clock: the phase, or the time */
        for (long column = 1; column < width; column++)
            for (long k = 0; k < components; k++) {
                const double *mean = means + k * width, *cover = covariances + k * width * width;
                output[column] += weight[k] / total * (mean[column] + cover[column * width] / cover[0] * (clock - mean[0]));
            }
        double length = 0; /* of the quaternion x y z w that may follow the position: it has to be 1 */
        for (long column = first + dimension; column < width; column++) length += output[column] * output[column];
        printf("%.17g", phase);
        for (long column = over_path ? 1 : 0; column < width; column++)
            printf(",%.17g", column < first + dimension ? output[column] : output[column] / sqrt(length));
        printf("\n");
    }
    return 0;
}
