// Below the surface, and not beside it.
bool inside(vec3 p) {
    vec3 q = (p - center) * rotation;
    vec2 at = q.xz * patches / size.xz + patches / 2.0;
    if (at != clamp(at, vec2(0.0), patches)) return false;
    ivec2 cell = clamp(ivec2(floor(at)), ivec2(0), ivec2(patches) - 1);
    return q.y < surface(cell, at - vec2(cell)).x;
}
