// Billboard of a capped cylinder: a rectangle that is tight to its outline.
//
// Camera frame as everywhere else: x right, y down, z forward; lengths in meters. The
// rectangle lies along the axis as it is seen. Its sides come from the support function
// of the outline, the larger of those of the two end discs. Fields: center, axis, radius,
// height.

vec4 billboard(vec2 corner) {
    vec3 below = center - axis * (height / 2.0), above = center + axis * (height / 2.0);
    vec2 along = direction_of(seen_axis(center, axis));
    vec2 n = corner.x * along, m = corner.y * vec2(-along.y, along.x);
    float ahead = max(disc_support(n, below, axis, radius),
                      disc_support(n, above, axis, radius));
    float beside = max(disc_support(m, below, axis, radius),
                       disc_support(m, above, axis, radius));
    bool in_front = disc_in_front(below, axis, radius)
        && disc_in_front(above, axis, radius);
    return clip_of_rectangle(corner, n, ahead, m, beside, in_front);
}
