// Billboard of what may be seen anywhere: the whole image.

vec4 billboard(vec2 corner) {
    return clip_of_corner(corner);
}
