"""Carries landmarks of templates to the other specimens of a collection, one specimen after another."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from collalign.confidence.radius_model import (
    Calibration,
    RadiusEvidence,
    beyond_range,
    calibrate,
    ellipsoids,
    radii,
)
from collalign.engine.session import ProgressFactory, each_shown
from collalign.output.collection import Collection
from collalign.registration.surface import RegistrationSurface
from collalign.template_landmarks.carry import (
    Template,
    at_places,
    carried,
    fuse,
    mean_of_trusted,
    off_surface,
    on_surface,
    template,
    template_distance,
    template_weights,
)
from collalign.template_landmarks.consensus import agreement_notes, order_mistakes, template_trust
from collalign.template_landmarks.local_fit import FIT, Surroundings, fit_surroundings, holds
from collalign.template_landmarks.table import LandmarkTable, evenly_spaced, may_be_one
from collalign.tools.correspond import DenseCorrespondence
from collalign.tools.transfer.posed_specimens import PosedSpecimens, SpecimenSurface, why_lost
from collalign.tools.transfer.result import (
    CARRIED,
    CONTRADICTED,
    MISSING_PLACE,
    OUT_OF_RANGE,
    PLACED,
    UNKNOWN,
    TransferredLandmarks,
)
from collalign.tools.transfer.surface_points import with_surface_points
from data_tools.arrays import FloatArray, read_only
from data_tools.errors import InputError
from data_tools.notes import Note


class LandmarkCarrier:
    """Carries landmarks from templates to the other specimens of a collection.

    Parameters
    ----------
    collection : Collection
    dense : DenseCorrespondence
        Of its shapes.
    table : LandmarkTable
        Landmarks of the templates, at least one of which is registered. Where some have a sure pose, those in doubt
        are not carried.
    """

    def __init__(
        self, collection: Collection, dense: DenseCorrespondence, table: LandmarkTable
    ) -> None:
        self._collection, self._dense, self._labels, self._known = (
            collection,
            dense,
            table.labels,
            table.points,
        )
        self._semilandmarks = table.semilandmarks
        self._specimens = PosedSpecimens(collection, dense)
        self._radius = radius = self._specimens.radius
        self.templates: list[Template] = []
        self._around: dict[int, Surroundings] = {}
        registered = [name for name in table.points if name in self._specimens.rows]
        self._doubtful = tuple(name for name in registered if self._specimens.is_doubtful(name))
        self._only_doubtful = len(self._doubtful) == len(registered)
        for name in registered:
            if self._only_doubtful or name not in self._doubtful:
                item, around = self._read_template(name, table.points[name])
                self.templates.append(item)
                self._around[item.shape] = around
        if not self.templates:
            raise InputError("landmarks: none of the specimens with landmarks could be registered")
        said = carried(self.templates, dense.mean)
        on_curves = np.setdiff1d(np.arange(len(table.labels)), table.landmark_rows)
        self._mistakes, self._wrong = order_mistakes(_without(said, np.s_[:, on_curves]))
        self.trust = template_trust(_without(said, self._wrong))
        known = np.isfinite(said).all(axis=2).any(axis=0)
        self._contradicted = known & ~self.trust.any(axis=0)
        self.templates = [
            replace(item, trust=own) for item, own in zip(self.templates, self.trust, strict=True)
        ]
        copies = [(item, dense.completed[item.shape]) for item in self.templates]
        self._holds = {
            item.shape: holds(item.places.on(copy), copy, dense.faces, radius)[0]
            for item, copy in copies
        }
        self._variation = float(np.sqrt(((dense.completed - dense.mean) ** 2).sum(axis=2).mean()))

    def same_places(self) -> dict[str, dict[str, str]]:
        """Return labels that a program counted on, by template, with those that other templates have at their places.

        Each is on one side only: a landmark was deleted and placed again.
        """
        names = [self._dense.names[item.shape] for item in self.templates]
        found: dict[str, dict[str, str]] = {}
        for one in self._mistakes:
            label, place = (self._labels[row] for row in (one.rows[0], one.places[0]))
            if one.kind == "renamed" and may_be_one(label, place):
                at, own, taken = (
                    (one.template, label, place) if one.decided else (one.other, place, label)
                )
                found.setdefault(names[at], {})[own] = taken
        return found

    def run(
        self, surface_points: int, progress: ProgressFactory | None = None
    ) -> TransferredLandmarks:
        """Predict every specimen, and every template from the others; and spread points over all surfaces."""
        predicted, errors, evidence = self._leave_one_out()
        lengths = np.linalg.norm(errors, axis=2)
        right = _without(lengths, self._wrong)
        calibration = calibrate(right, evidence)
        held = [one.held_errors(own) for one, own in zip(evidence, errors, strict=True)]
        of_held = calibrate(_without(np.array(held), self._wrong), evidence)
        specimens = each_shown(self._collection.names, "specimens", progress)
        found = [self._specimen(name, calibration, of_held) for name in specimens]
        names = tuple(self._dense.names[item.shape] for item in self.templates)
        unit = np.array([self._specimens.scale(name) for name in names])[:, None]
        rest = [evidence[:at] + evidence[at + 1 :] for at in range(len(evidence))]
        without = [calibrate(np.delete(right, at, 0), others) for at, others in enumerate(rest)]
        radius = np.array([radii(one, own) for one, own in zip(without, evidence, strict=True)])
        moved = TransferredLandmarks(
            names=self._collection.names,
            labels=self._labels,
            points=read_only(np.stack([points for points, _, _, _ in found])),
            radii=read_only(np.stack([radius for _, radius, _, _ in found])),
            ellipsoids=read_only(np.stack([axes for _, _, axes, _ in found])),
            status=tuple(status for _, _, _, status in found),
            templates=names,
            template_trust=read_only(self.trust),
            left_out_points=read_only(predicted),
            left_out_errors=read_only(lengths / unit),
            left_out_radii=read_only(radius / unit),
            semilandmarks=self._semilandmarks,
            notes=(
                *self._doubtful_notes(),
                *agreement_notes(
                    self._mistakes,
                    names,
                    self._labels,
                    lengths / unit,
                    self._radius / unit[:, 0],
                    self.trust,
                ),
            ),
        )
        if not surface_points:
            return moved
        return with_surface_points(moved, self._specimens, surface_points)

    def _leave_one_out(self) -> tuple[FloatArray, FloatArray, list[RadiusEvidence]]:
        """Predict templates from the others.

        Returns
        -------
        points : ndarray, shape (t, l, 3)
            In the coordinates of each template's file.
        errors : ndarray, shape (t, l, 3)
            In the common frame.
        evidence : list of RadiusEvidence
        """
        shape = (len(self.templates), len(self._labels))
        if len(self.templates) < 2:
            nothing = np.full((*shape, 3), np.nan)
            return nothing, nothing, [RadiusEvidence.unknown(shape[1])]
        predicted, errors, evidence = [], [], []
        for at, item in enumerate(self.templates):
            name = self._dense.names[item.shape]
            others = self.templates[:at] + self.templates[at + 1 :]
            points, shown, _ = self.predict(self.look_at(name), others)
            predicted.append(self._specimens.in_file(name, points))
            errors.append(self.errors(name, points))
            evidence.append(shown)
        return np.array(predicted), np.array(errors), evidence

    def _specimen(
        self, name: str, calibration: Calibration, of_held: Calibration
    ) -> tuple[FloatArray, FloatArray, FloatArray, tuple[str, ...]]:
        """Return points, radii and ellipsoids in the file's unit, and what became of each landmark."""
        own = self._known.get(name, np.full((len(self._labels), 3), np.nan))
        placed = np.isfinite(own).all(axis=1)
        points, radius = np.array(own), np.where(placed, 0.0, np.nan)
        axes = np.repeat(radius, 9).reshape(-1, 3, 3)
        reason = self._specimens.abstention(name)
        known = (
            np.isfinite(np.stack([item.offsets for item in self.templates])).all(axis=2).any(axis=0)
        )
        reasons = np.where(known, MISSING_PLACE, UNKNOWN)
        if reason is None and not placed.all():
            predicted, evidence, lost = self.predict(self.look_at(name), self.templates)
            lost = np.where(self._contradicted, CONTRADICTED, lost)
            vague = beyond_range(calibration, evidence)
            predicted[(lost != "") | vague] = np.nan
            reasons = np.where(lost != "", lost, np.where(vague, OUT_OF_RANGE, reasons))
            points[~placed] = self._specimens.in_file(name, predicted)[~placed]
            radius[~placed] = radii(calibration, evidence)[~placed] / self._specimens.scale(name)
            inverse = np.linalg.inv(self._collection.transforms[self._collection.index(name)])
            axes[~placed] = (ellipsoids(of_held, evidence) @ inverse[:3, :3].T)[~placed]
            lacking = np.isnan(points).any(axis=1)
            radius[lacking], axes[lacking] = np.nan, np.nan
        there = np.isfinite(points).all(axis=1)
        words = np.where(placed, PLACED, np.where(there, CARRIED, reason or reasons))
        return points, radius, axes, tuple(words.tolist())

    def _doubtful_notes(self) -> tuple[Note, ...]:
        """Say which templates have poses in doubt: they do not count where others are sure."""
        if not self._doubtful:
            return ()
        return (Note("templates-doubtful", self._doubtful, {"counted": self._only_doubtful}),)

    def look_at(self, name: str) -> SpecimenSurface:
        """Read a specimen on which landmarks are to be predicted."""
        return self._specimens.look_at(name)

    def predict(
        self, specimen: SpecimenSurface, templates: list[Template]
    ) -> tuple[FloatArray, RadiusEvidence, NDArray[np.str_]]:
        """Predict the landmarks of a specimen from some templates.

        Returns
        -------
        points : ndarray, shape (l, 3)
            In the common frame.
        evidence : RadiusEvidence
        lost : ndarray of str, shape (l,)
            Why a landmark has no place on the specimen's surface; empty where it has one.
        """
        row, surface, dense = specimen.row, specimen.surface, self._dense
        said = carried(templates, dense.vertices[row])
        weights = template_weights(templates, row, dense.vertices, dense.quality)
        mapped, spreads = fuse(said, weights)
        lost = np.where(off_surface(templates), "", why_lost(surface, mapped))
        mapped = on_surface(mapped, templates, surface.locator)
        places, misfits = self._local_fits(templates, specimen)
        points, _ = fuse(said + FIT.share * (places - said), weights)
        placed = self._evenly(on_surface(points, templates, surface.locator), templates, surface)
        held = holds(np.nan_to_num(mapped), dense.completed[row], dense.faces, self._radius)[1]
        slips = places - mapped
        seen = np.linalg.norm(np.einsum("lij,tlj->tli", held, slips), axis=2)
        evidence = RadiusEvidence(
            spread=spreads,
            distance=template_distance(templates, row, dense.vertices),
            residual=mean_of_trusted(templates, at_places(templates, dense.residual[row])),
            unit=self._radius,
            variation=self._variation,
            hold=mean_of_trusted(
                templates, np.stack([self._holds[item.shape] for item in templates])
            ),
            slip=mean_of_trusted(templates, np.linalg.norm(slips, axis=2)),
            misfit=mean_of_trusted(templates, misfits),
            held=held,
            held_slip=np.sqrt(mean_of_trusted(templates, seen**2)),
        )
        return placed, evidence, lost

    def errors(self, name: str, points: FloatArray) -> FloatArray:
        """Return predicted landmarks less a template's own, in the common frame, shape (l, 3)."""
        return points - self._specimens.posed(name, self._known[name])

    def _read_template(self, name: str, points: FloatArray) -> tuple[Template, Surroundings]:
        """Return a template and the surroundings of its landmarks, which are points (l, 3) of its file."""
        row, mean = self._specimens.rows[name], self._dense.mean
        surface, posed = self._specimens.surface(name), self._specimens.posed(name, points)
        item = template(
            row, posed, self._dense.completed[row], self._dense.faces, self._radius, surface.locator
        )
        return item, Surroundings.of(
            posed, item.places.on(mean), surface.vertices, mean, self._radius
        )

    def _local_fits(
        self, templates: list[Template], specimen: SpecimenSurface
    ) -> tuple[FloatArray, FloatArray]:
        """Return where rigid fits of what is around landmarks take them, (t, l, 3), and their misfits, (t, l)."""
        for shape in {item.shape for item in templates} - {*specimen.fits}:
            specimen.fits[shape] = fit_surroundings(
                self._around[shape],
                self._dense.completed[shape],
                specimen.copy,
                specimen.surface.locator,
                specimen.normals,
                self._radius,
            )
        places, misfits = zip(*(specimen.fits[item.shape] for item in templates), strict=True)
        return np.stack(places), np.stack(misfits)

    def _evenly(
        self, placed: FloatArray, templates: list[Template], surface: RegistrationSurface
    ) -> FloatArray:
        """Return landmarks (l, 3) with semilandmarks of curves at even distances on the surface."""
        for curve in self._semilandmarks:
            rows = list(curve.rows)
            if curve.kind != "patch" and np.isfinite(placed[rows]).all():
                spaced = evenly_spaced(placed[rows], len(rows), closed=curve.kind == "closed curve")
                placed[rows] = on_surface(
                    spaced, [item.only(rows) for item in templates], surface.locator
                )
        return placed


def _without(values: FloatArray, where: Any) -> FloatArray:
    """Return a copy with NaN in some places."""
    left = np.array(values)
    left[where] = np.nan
    return left
