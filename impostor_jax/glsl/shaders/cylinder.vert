// Billboard of a capped cylinder: a rectangle that is tight to its outline.
//
// Camera frame as everywhere else: x right, y down, z forward; lengths in meters. The
// rectangle lies along the axis as it is seen. Its sides come from the support function
// of the outline, the larger of those of the two end discs (rendering/outline.py).
// Fields: center, axis, radius, height.

#ifdef AS_PUBLISHED

vec4 billboard(vec2 corner) {
    // Fault 3: this square cuts off corners, and more in perspective.
    float half_size = max(radius, height / 2.0);
    return clip_of_point(center + vec3(corner * half_size, 0.0));
}

#else

// v.w without the parts along the axis.
float across(vec3 v, vec3 w, vec3 a) {
    return dot(v, w) - dot(v, a) * dot(w, a);
}

#ifdef ORTHOGRAPHIC

float disc_support(vec2 n, vec3 c, vec3 a, float r) {
    float n_a = dot(n, a.xy);
    return dot(n, c.xy) + r * sqrt(max((1.0 - n_a) * (1.0 + n_a), 0.0));
}

vec2 seen_axis(vec3 c, vec3 a) {
    return a.xy;
}

bool in_front(vec3 below, vec3 above, vec3 a, float r) {
    return true;
}

#else

// Largest n.x over the image of a disc in the plane z = 1, from its dual conic.
float disc_support(vec2 n, vec3 c, vec3 a, float r) {
    vec3 normal = vec3(n, 0.0), forward = vec3(0.0, 0.0, 1.0);
    float n_n = across(normal, normal, a), n_z = across(normal, forward, a);
    float z_z = across(forward, forward, a);
    vec3 w = normal * c.z - forward * dot(normal, c);
    float gap = r * r * (across(w, w, a) - r * r * (n_n * z_z - n_z * n_z));
    float scale = c.z * c.z - r * r * z_z;
    return (dot(normal, c) * c.z - r * r * n_z + sqrt(max(gap, 0.0))) / scale;
}

vec2 seen_axis(vec3 c, vec3 a) {
    return a.xy * c.z - c.xy * a.z;
}

bool in_front(vec3 below, vec3 above, vec3 a, float r) {
    float reach = r * sqrt(max((1.0 - a.z) * (1.0 + a.z), 0.0));
    return min(below.z, above.z) > reach;
}

#endif

vec4 billboard(vec2 corner) {
    vec3 below = center - axis * (height / 2.0), above = center + axis * (height / 2.0);
    vec2 along = direction_of(seen_axis(center, axis));
    vec2 n = corner.x * along, m = corner.y * vec2(-along.y, along.x);
    float ahead = max(disc_support(n, below, axis, radius),
                      disc_support(n, above, axis, radius));
    float beside = max(disc_support(m, below, axis, radius),
                       disc_support(m, above, axis, radius));
    return clip_of_rectangle(
        corner, n, ahead, m, beside, in_front(below, above, axis, radius)
    );
}

#endif
