/* Products of a vector with a matrix whose rows are outputs, stored output by output next to each other. */
#ifndef SW_PRODUCTS_H
#define SW_PRODUCTS_H

/* outputs[o] = sum over i of weights[i][o] values[i], with a number of outputs that is a multiple of four: four at a time
 * share the loads of the values, and their sums do not wait for each other.
 */
static inline void sw_products(float *outputs, const float *weights, int width, const float *values, int count)
{
    for (int first = 0; first < width; first += 4) {
        float s0 = 0.0f, s1 = 0.0f, s2 = 0.0f, s3 = 0.0f;
        for (int i = 0; i < count; i++) {
            const float *of = &weights[i * width + first], value = values[i];
            s0 += of[0] * value;
            s1 += of[1] * value;
            s2 += of[2] * value;
            s3 += of[3] * value;
        }
        outputs[first] = s0;
        outputs[first + 1] = s1;
        outputs[first + 2] = s2;
        outputs[first + 3] = s3;
    }
}

#endif
