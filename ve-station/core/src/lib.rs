//! The pure core of the VE station: closures of regions, and the answers to controllers.
//!
//! | module | content |
//! |---|---|
//! | `collection` | mesh collection: the closure of a region, and residency at a client |
//! | `sparse` | values by id, most of which are zero |
//! | `station` | sessions: requests in, chunks out |
//! | `tour` | scripted paths over any mesh, from a seed |
//!
//! ```
//! use bytemuck::Zeroable;
//! use protocol::{AnswerItem, AnswersReader, RegionAction, RegionAsk, Request, RequestKind};
//! use spm::{SpmFile, SpmParts, write_spm};
//! use station_core::station::{Message, ServedModel, ServedObject, Station};
//!
//! // A station that serves a model of eight faces and one split.
//! let mut bytes = Vec::new();
//! write_spm(&SpmParts::hexagon(), &mut bytes)?;
//! let file = SpmFile::open(bytes)?;
//! let (model, region) = (file.model_header().model, file.regions()[0]);
//! let served = ServedModel { name: "hexagon".to_owned(), file };
//! let object = ServedObject { model: 0, name: Request::name_hash("hexagon") };
//! let mut station = Station::new(1, vec![served], vec![object]);
//!
//! // Client 7 subscribes to a region at full resolution.
//! let mut request = Request::zeroed();
//! request.client = 7;
//! request.model = model;
//! request.kind = RequestKind::Regions as u32;
//! request.credit = 1;
//! request.count = 1;
//! request.regions[0] = RegionAsk {
//!     region: region.0,
//!     action: RegionAction::Subscribe as u32,
//!     ..RegionAsk::zeroed()
//! };
//! station.handle(Message::Request(&request));
//!
//! // The answer: the id of the split in the closure, then its record.
//! let (header, slots) = station.poll(7).ok_or("no answer")?;
//! assert_eq!(header.last, 1);
//! let mut reader = AnswersReader::new(header.count);
//! let (mut ids, mut records) = (0, 0);
//! while let Some(item) = reader.next(&slots).map_err(|_| "damaged")? {
//!     match item {
//!         AnswerItem::Id { .. } => ids += 1,
//!         AnswerItem::Record(_) => records += 1,
//!         _ => {}
//!     }
//! }
//! assert_eq!((ids, records), (1, 1));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

#![deny(clippy::disallowed_methods, clippy::disallowed_types)]
#![forbid(unsafe_code)]

pub mod collection;
mod sparse;
pub mod station;
#[cfg(test)]
mod testing;
pub mod tour;
mod tuning;
