use std::fmt;

use prometheus_client::collector::Collector;
use prometheus_client::encoding::text::encode;
use prometheus_client::encoding::{DescriptorEncoder, MetricEncoder, NoLabelSet};
use prometheus_client::metrics::MetricType;
use prometheus_client::registry::{Registry, Unit};

/// Prefix of every metric name.
const PREFIX: &str = "upm";

type Labels = Vec<(&'static str, String)>;

/// One value with its labels.
#[derive(Debug)]
pub(super) struct MetricSample {
    labels: Labels,
    value: f64,
}

impl MetricSample {
    pub fn new(labels: Labels, value: f64) -> Self {
        Self { labels, value }
    }

    pub fn of_plate(plate: &str, value: f64) -> Self {
        Self::new(vec![("plate", plate.to_owned())], value)
    }
}

/// All samples of one metric. `name` is without prefix, unit and `_total`; the encoder adds those.
#[derive(Debug)]
pub(super) struct MetricFamily {
    name: &'static str,
    help: &'static str,
    unit: Option<Unit>,
    kind: MetricType,
    samples: Vec<MetricSample>,
}

impl MetricFamily {
    /// A value that rises and falls.
    pub fn gauge(name: &'static str, help: &'static str) -> Self {
        Self { name, help, unit: None, kind: MetricType::Gauge, samples: Vec::new() }
    }

    /// A value that only rises until the daemon restarts.
    pub fn counter(name: &'static str, help: &'static str) -> Self {
        Self { kind: MetricType::Counter, ..Self::gauge(name, help) }
    }

    /// A constant, carried by its labels.
    pub fn info(name: &'static str, help: &'static str, labels: Labels) -> Self {
        Self { kind: MetricType::Info, samples: vec![MetricSample::new(labels, 1.0)], ..Self::gauge(name, help) }
    }

    pub fn in_unit(self, unit: Unit) -> Self {
        Self { unit: Some(unit), ..self }
    }

    /// The family with its only sample.
    pub fn with(self, value: f64) -> Self {
        self.with_all([MetricSample::new(Vec::new(), value)])
    }

    pub fn with_all(self, samples: impl IntoIterator<Item = MetricSample>) -> Self {
        Self { samples: samples.into_iter().collect(), ..self }
    }

    fn encode(&self, encoder: &mut DescriptorEncoder<'_>) -> fmt::Result {
        let mut encoder = encoder.encode_descriptor(self.name, self.help, self.unit.as_ref(), self.kind)?;
        for MetricSample { labels, value } in &self.samples {
            match self.kind {
                MetricType::Info => encoder.encode_info(labels)?,
                _ if labels.is_empty() => self.put(&mut encoder, *value)?,
                _ => self.put(&mut encoder.encode_family(labels)?, *value)?,
            }
        }
        Ok(())
    }

    fn put(&self, encoder: &mut MetricEncoder<'_>, value: f64) -> fmt::Result {
        match self.kind {
            MetricType::Counter => encoder.encode_counter::<NoLabelSet, u64, f64>(&(value as u64), None),
            _ => encoder.encode_gauge(&value),
        }
    }
}

#[derive(Debug)]
struct Families(Vec<MetricFamily>);

impl Collector for Families {
    fn encode(&self, mut encoder: DescriptorEncoder<'_>) -> fmt::Result {
        self.0.iter().try_for_each(|family| family.encode(&mut encoder))
    }
}

/// The families as OpenMetrics text.
pub(super) fn written(families: Vec<MetricFamily>) -> String {
    let mut registry = Registry::with_prefix(PREFIX);
    registry.register_collector(Box::new(Families(families)));
    let mut text = String::new();
    // writing to a string never fails
    encode(&mut text, &registry).unwrap_or_default();
    text
}
