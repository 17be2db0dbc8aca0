// An instance's samples, which lie one after the other in the rows of a texture.

uniform highp sampler2D samples;

float sample_at(int k) {
    k += int(first_sample);
    return texelFetch(samples, ivec2(k % SAMPLES_PER_ROW, k / SAMPLES_PER_ROW), 0).r;
}
