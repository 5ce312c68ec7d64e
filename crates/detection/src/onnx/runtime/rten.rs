//! `rten`: pure Rust, needs no library of the system, always there.

use super::{Session, Tensor, one_line};
use rten::{Model, NodeId, RunOptions, ThreadPool, Value, ValueView};
use rten_tensor::Layout;
use std::sync::Arc;

/// As summaries name it; a test holds it against Cargo.lock.
const RUNTIME: &str = "rten 0.24.0";

/// A model in `rten`.
pub(super) struct RtenSession {
    model: Model,
    input: NodeId,
    pool: Arc<ThreadPool>,
}

impl RtenSession {
    /// Loads a model whose image goes into `input`.
    pub(super) fn load(bytes: Vec<u8>, input: &str, threads: usize) -> Result<Self, String> {
        let model = Model::load(bytes).map_err(|e| one_line(&e))?;
        let input = model.node_id(input).map_err(|e| one_line(&e))?;
        Ok(Self {
            model,
            input,
            pool: Arc::new(ThreadPool::with_num_threads(threads)),
        })
    }
}

impl Session for RtenSession {
    fn run(&mut self, planes: &[f32], width: usize, height: usize) -> Result<Vec<Tensor>, String> {
        let shape = [1, 3, height, width];
        let input = ValueView::from_shape(shape.as_slice(), planes).map_err(|e| one_line(&e))?;
        // Its own threads, since the default pool takes all cores.
        let options = RunOptions::default().with_thread_pool(Some(Arc::clone(&self.pool)));
        let outputs = self
            .model
            .run(
                vec![(self.input, input.into())],
                self.model.output_ids(),
                Some(options),
            )
            .map_err(|e| one_line(&e))?;
        outputs.into_iter().map(tensor).collect()
    }

    fn runtime(&self) -> &str {
        RUNTIME
    }
}

/// An output's numbers.
fn tensor(value: Value) -> Result<Tensor, String> {
    let shape = value.shape().to_vec();
    let data = match value {
        Value::FloatTensor(t) => t.into_data(),
        Value::Int32Tensor(t) => t.into_data().into_iter().map(|v| v as f32).collect(),
        _ => return Err("an output that holds no numbers".to_owned()),
    };
    Ok(Tensor { shape, data })
}
