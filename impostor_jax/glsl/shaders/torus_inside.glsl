bool inside(vec3 p) {
    vec3 q = p - center;
    float along = dot(q, axis);
    return length(vec2(length(q - axis * along) - major_radius, along)) < minor_radius;
}
