// Published billboard of a capped cylinder. Fields: center, axis, radius, height.

// Cut off by the near plane, as a mesh would be.
vec4 clip_of_point(vec3 p) {
#ifdef ORTHOGRAPHIC
    return clip_of_pixel(focal * p.xy + principal);
#else
    vec4 center = clip_of_pixel(principal);
    vec2 slope = 2.0 * focal / image_size * vec2(1.0, -1.0);
    float near = 1e-3 * (depth_range.x + depth_range.y);
    return vec4(center.xy * p.z + slope * p.xy, p.z - 2.0 * near, p.z);
#endif
}

vec4 billboard(vec2 corner) {
    // Fault 3: this square cuts off corners, and more in perspective.
    float half_size = max(radius, height / 2.0);
    return clip_of_point(center + vec3(corner * half_size, 0.0));
}
