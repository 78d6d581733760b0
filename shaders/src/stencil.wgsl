// The seven-point operator in the form of fluxes: with differences of neighbours taken before they
// are weighted, single precision loses nothing where the field is smooth.
// Twin: inflow in diffusion/src/cpu/sweep.rs.
//
// The kernel that follows says what it looks at: value(place, i), its field at position i.

// Σ over the six faces of conductance · (value beyond it − own).
fn inflow(place: vec3<u32>, i: u32, own: vec4<f32>) -> vec4<f32> {
    let n = level.cells;
    let step = vec3(1u, n.x, n.x * n.y) * level.quads;
    let below = faces_below(place);
    let above = faces_above(place);
    var low_x = vec4(0.0);
    var low_y = vec4(0.0);
    var low_z = vec4(0.0);
    var high_x = vec4(0.0);
    var high_y = vec4(0.0);
    var high_z = vec4(0.0);
    if place.x > 0u {
        low_x = value(place - vec3(1u, 0u, 0u), i - step.x);
    }
    if place.x + 1u < n.x {
        high_x = value(place + vec3(1u, 0u, 0u), i + step.x);
    }
    if place.y > 0u {
        low_y = value(place - vec3(0u, 1u, 0u), i - step.y);
    }
    if place.y + 1u < n.y {
        high_y = value(place + vec3(0u, 1u, 0u), i + step.y);
    }
    if place.z > 0u {
        low_z = value(place - vec3(0u, 0u, 1u), i - step.z);
    }
    if place.z + 1u < n.z {
        high_z = value(place + vec3(0u, 0u, 1u), i + step.z);
    }
    return face_x[below.x] * (low_x - own) + face_x[above.x] * (high_x - own)
        + face_y[below.y] * (low_y - own) + face_y[above.y] * (high_y - own)
        + face_z[below.z] * (low_z - own) + face_z[above.z] * (high_z - own);
}
