// Conductances across all faces from what conducts, κ or D: harmonic between cells, the boundary's on the surface. Those of
// κφ: the same between all cells, the boundary's over κ.
// Twin: Operator::new in diffusion/src/operator.rs.

@group(1) @binding(1) var<storage, read> kappa: array<f32>;
@group(1) @binding(2) var<storage, read_write> across_x: array<f32>;
@group(1) @binding(3) var<storage, read_write> across_y: array<f32>;
@group(1) @binding(4) var<storage, read_write> across_z: array<f32>;

// The conductance of face `at` (0 to n) of an axis on which `below` is the cell under it.
fn conductance(axis: u32, at: u32, below: u32, above: u32) -> f32 {
    let h = block.spacing[axis];
    let area = block.volume / h;
    let n = level.cells[axis];
    if at > 0u && at < n {
        let a = kappa[below];
        let b = kappa[above];
        if block.stam == 1u {
            return area / h;
        }
        return 2.0 * area * a * b / (h * (a + b));
    }
    if axis < 2u && block.closed == 1u {
        return 0.0;
    }
    let own = kappa[select(above, below, at == n)];
    if block.stam == 1u {
        return area / (2.0 * block.boundary_constant * own + 0.5 * h);
    }
    return area / (2.0 * block.boundary_constant + h / (2.0 * own));
}

// Faces are taken by rows one longer than the cells' along every axis.
@compute @workgroup_size(64)
fn conduct(@builtin(global_invocation_id) id: vec3<u32>) {
    let n = level.cells;
    if any(id > n) {
        return;
    }
    let held = min(id, n - 1u);
    let cell = cell_at(held);
    let below = faces_below(id);
    if id.y < n.y && id.z < n.z {
        across_x[below.x] = conductance(0u, id.x, cell - select(1u, 0u, id.x == 0u || id.x == n.x), cell);
    }
    if id.x < n.x && id.z < n.z {
        let back = select(n.x, 0u, id.y == 0u || id.y == n.y);
        across_y[below.y] = conductance(1u, id.y, cell - back, cell);
    }
    if id.x < n.x && id.y < n.y {
        let back = select(n.x * n.y, 0u, id.z == 0u || id.z == n.z);
        across_z[below.z] = conductance(2u, id.z, cell - back, cell);
    }
}
