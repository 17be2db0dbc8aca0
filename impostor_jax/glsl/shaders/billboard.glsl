// Rectangles around an outline, which vertex shaders span by its support functions.

// Unit vector along v; the x axis where v is zero.
vec2 direction_of(vec2 v) {
    // Its largest component first, so that no square under- or overflows.
    float largest = max(abs(v.x), abs(v.y));
    return largest > 0.0 ? normalize(v / largest) : vec2(1.0, 0.0);
}

// Corner where the outline's tangents across the unit vectors n and m meet.
//
// ahead and beside are the outline's largest n.x and m.x over its points x of the plane
// z = 1 (or, of parallel rays, z = 0). The whole image where it has no such tangents.
vec4 clip_of_rectangle(
    vec2 corner, vec2 n, float ahead, vec2 m, float beside, bool in_front
) {
    // A driver snaps corners to parts of a pixel, and the support is rounded.
    float margin = 0.25 / min(focal.x, focal.y);
    ahead += margin + 1e-6 * abs(ahead);
    beside += margin + 1e-6 * abs(beside);
    bool tight = in_front
        && max(abs(ahead), abs(beside)) * max(focal.x, focal.y) < 1e6;
    return tight ? clip_of_pixel(focal * (ahead * n + beside * m) + principal)
                 : clip_of_corner(corner);
}
