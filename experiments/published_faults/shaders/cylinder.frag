// First surface of a capped cylinder on the ray of a pixel, as published, with its faults.
//
// Fields: center, axis, radius, height.

// Rotation that takes the unit vector a to +y.
mat3 upright(vec3 a) {
    vec3 u = normalize(abs(a.x) < 0.5 ? cross(a, vec3(1.0, 0.0, 0.0))
                                      : cross(a, vec3(0.0, 0.0, 1.0)));
    return transpose(mat3(u, a, cross(u, a)));
}

Surface intersect(vec3 o, vec3 d) {
    float r = radius, h = height / 2.0;
    mat3 rotation = upright(axis);
    vec3 c = rotation * (center - o), e = rotation * d;
    float cap_t = -1.0, side_t = -1.0;
    if (e.y != 0.0) {
        float t0 = (c.y - h) / e.y, t1 = (c.y + h) / e.y;
        // Fault 4: between the planes no cap is seen.
        if (t0 > 0.0 && t1 > 0.0) {
            float t = min(t0, t1);
            vec2 aside = t * e.xz - c.xz;
            if (dot(aside, aside) <= r * r) cap_t = t;
        }
    }
    float A = dot(e.xz, e.xz), B = -2.0 * dot(e.xz, c.xz), C = dot(c.xz, c.xz) - r * r;
    // Fault 5: two large numbers, nearly equal.
    float discriminant = B * B - 4.0 * A * C;
    if (discriminant >= 0.0) {
        // Fault 4: only the smaller root, even behind the camera.
        float t = (-B - sqrt(discriminant)) / (2.0 * A);
        if (abs(t * e.y - c.y) < h) side_t = t;
    }
    bool on_cap = cap_t > 0.0 && (side_t <= 0.0 || cap_t < side_t);
    float t = on_cap ? cap_t : side_t;
    if (!(t > 0.0)) return MISS;
    vec3 q = o + t * d - center;
    vec3 n = normalize(q);  // Fault 1: that of a sphere.
    // Fault 2: compared with the unit axis, whatever the cylinder's size.
    if (on_cap) n = length(q + axis) > length(q) ? axis : -axis;
    return Surface(t, n, int(on_cap));
}
