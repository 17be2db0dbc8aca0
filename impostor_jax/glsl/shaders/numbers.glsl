// The numbers of shapes and lights, four together, which lie one after the other in the
// rows of a texture.

uniform highp sampler2D numbers;

vec4 number_at(int place) {
    return texelFetch(numbers, ivec2(place % TEXELS_PER_ROW, place / TEXELS_PER_ROW), 0);
}
