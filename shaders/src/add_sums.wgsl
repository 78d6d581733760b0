// Adds up what the workgroups of a kernel left, onto what is there already. One workgroup; an entry
// point for each kernel's place in totals.

@group(1) @binding(1) var<storage, read_write> totals: array<vec4<f32>>;

fn add_to(place: u32, local: u32) {
    let sum = total(local, 1u);
    if local == 0u {
        totals[place] += sum;
    }
}

@compute @workgroup_size(THREADS)
fn add_of_radiance(@builtin(local_invocation_index) local: u32) {
    add_to(0u, local);
}

@compute @workgroup_size(THREADS)
fn add_of_misfit(@builtin(local_invocation_index) local: u32) {
    add_to(1u, local);
}

@compute @workgroup_size(THREADS)
fn add_of_smoothness(@builtin(local_invocation_index) local: u32) {
    add_to(2u, local);
}
