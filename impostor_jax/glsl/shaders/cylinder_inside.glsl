bool inside(vec3 p) {
    vec3 q = p - center;
    float along = dot(q, axis);
    return length(q - axis * along) < radius && abs(along) < height / 2.0;
}
