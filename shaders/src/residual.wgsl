// r = b − A x, A the seven-point finite-volume operator, for 16 right-hand sides side by side.
// Twin: Operator::residual in diffusion/src/operator.rs.
//
// An invocation makes one value: one lane of one cell. Neighbouring invocations share a cell, so
// that its coefficients are read once for all lanes and the fields in whole cache lines.

const LANES: u32 = 16u;

@group(0) @binding(0) var<uniform> cells: vec4<u32>; // nx, ny, nz, unused
@group(0) @binding(1) var<storage, read> link_x: array<f32>; // to the next cell along x
@group(0) @binding(2) var<storage, read> link_y: array<f32>;
@group(0) @binding(3) var<storage, read> link_z: array<f32>;
@group(0) @binding(4) var<storage, read> diagonal: array<f32>;
@group(0) @binding(5) var<storage, read> b: array<f32>;
@group(0) @binding(6) var<storage, read> x: array<f32>;
@group(0) @binding(7) var<storage, read_write> r: array<f32>;

@compute @workgroup_size(64)
fn residual(@builtin(global_invocation_id) id: vec3<u32>) {
    let lane = id.x % LANES;
    let place = vec3(id.x / LANES, id.y, id.z);
    if any(place >= cells.xyz) {
        return;
    }
    let row = cells.x;
    let plane = cells.x * cells.y;
    let cell = place.z * plane + place.y * row + place.x;

    var sum = b[cell * LANES + lane] - diagonal[cell] * x[cell * LANES + lane];
    if place.x > 0u {
        sum += link_x[cell - 1u] * x[(cell - 1u) * LANES + lane];
    }
    if place.x + 1u < cells.x {
        sum += link_x[cell] * x[(cell + 1u) * LANES + lane];
    }
    if place.y > 0u {
        sum += link_y[cell - row] * x[(cell - row) * LANES + lane];
    }
    if place.y + 1u < cells.y {
        sum += link_y[cell] * x[(cell + row) * LANES + lane];
    }
    if place.z > 0u {
        sum += link_z[cell - plane] * x[(cell - plane) * LANES + lane];
    }
    if place.z + 1u < cells.z {
        sum += link_z[cell] * x[(cell + plane) * LANES + lane];
    }
    r[cell * LANES + lane] = sum;
}
