"""The Slicer module: a folder of shapes in, aligned models, transforms, doubts and corresponding points out."""

from __future__ import annotations

from pathlib import Path

import ctk
import qt
import slicer
import vtk
from CollalignLib.results import Results, read_results
from CollalignLib.running import PACKAGE, command, run
from slicer.ScriptedLoadableModule import (
    ScriptedLoadableModule,
    ScriptedLoadableModuleLogic,
    ScriptedLoadableModuleTest,
    ScriptedLoadableModuleWidget,
)

#: Colours of sure poses and of poses in doubt.
SURE, DOUBTED = (0.82, 0.80, 0.74), (0.90, 0.45, 0.13)


class Collalign(ScriptedLoadableModule):
    """What the module is called and says about itself."""

    def __init__(self, parent):
        ScriptedLoadableModule.__init__(self, parent)
        parent.title = "Collalign"
        parent.categories = ["Registration", "SlicerMorph"]
        parent.dependencies = []
        parent.contributors = ["The collalign developers"]
        parent.helpText = (
            "Aligns all shapes of a folder consistently, mirrors left and right specimens onto each other where "
            "the folder mixes them, and says which poses need a look."
        )
        parent.acknowledgementText = (
            "Maron et al. (SIGGRAPH 2016), Point Registration via Efficient Convex Relaxation."
        )


class CollalignWidget(ScriptedLoadableModuleWidget):
    """The panel: two folders, two choices, one button, a table of poses."""

    def setup(self):
        """Build the panel."""
        ScriptedLoadableModuleWidget.setup(self)
        self.logic = CollalignLogic()
        box = ctk.ctkCollapsibleButton()
        box.text = "Align a folder"
        self.layout.addWidget(box)
        form = qt.QFormLayout(box)
        self.folder = _folder_choice("Meshes or point clouds in arbitrary poses")
        self.out = _folder_choice("Results; an empty folder, or one that an earlier run wrote")
        self.mirrored = qt.QComboBox()
        for text, value in (("notice by itself", "auto"), ("never", "SO"), ("allowed", "O")):
            self.mirrored.addItem(text, value)
        self.keepSizes = qt.QCheckBox()
        self.align = qt.QPushButton("Align")
        self.show = qt.QPushButton("Show results of the output folder")
        self.log = qt.QPlainTextEdit()
        self.log.readOnly = True
        for label, widget in (
            ("Shapes", self.folder),
            ("Output", self.out),
            ("Mirror images", self.mirrored),
            ("Keep sizes", self.keepSizes),
        ):
            form.addRow(label, widget)
        for widget in (self.align, self.show, self.log):
            form.addRow(widget)
        self.table = qt.QTableWidget(0, 2)
        self.table.setHorizontalHeaderLabels(["shape", "confidence"])
        form.addRow(self.table)
        self.layout.addStretch(1)
        self.align.connect("clicked(bool)", self.onAlign)
        self.show.connect("clicked(bool)", self.onShow)

    def onAlign(self):
        """Run the command, then show what it wrote."""
        with slicer.util.tryWithErrorDisplay(
            "The collection could not be aligned", waitCursor=True
        ):
            self.logic.ensureInstalled()
            self.log.clear()
            self.logic.align(
                Path(self.folder.currentPath),
                Path(self.out.currentPath),
                self.mirrored.currentData,
                self.keepSizes.checked,
                self._say,
            )
            self.onShow()

    def onShow(self):
        """Load aligned meshes, points and transforms into the scene and list the poses."""
        with slicer.util.tryWithErrorDisplay("The results could not be read", waitCursor=True):
            results = read_results(Path(self.out.currentPath))
            self.logic.show(results)
            self.table.setRowCount(len(results.shapes))
            for row, shape in enumerate(sorted(results.shapes, key=lambda s: s.confidence)):
                for column, text in enumerate((shape.name, shape.percent)):
                    self.table.setItem(row, column, qt.QTableWidgetItem(text))
            for note in results.notes:
                self._say(note)

    def _say(self, line):
        self.log.appendPlainText(line)
        slicer.app.processEvents()


class CollalignLogic(ScriptedLoadableModuleLogic):
    """Everything that touches the scene."""

    def ensureInstalled(self):
        """Install the package and what it depends on (about 500 MB) into Slicer's Python, after the user has agreed.

        Raises
        ------
        RuntimeError
            If the user declines, or the installation fails.
        """
        import slicer.packaging

        slicer.packaging.pip_ensure(PACKAGE, requester="Collalign")

    def align(self, folder, out, mirrored, keepSizes, report):
        """Run ``collalign align``.

        Raises
        ------
        RuntimeError
            If it ends without results; what it printed has been reported.
        """
        words = command(self.python(), folder, out, mirrored=mirrored, keep_sizes=keepSizes)
        if not run(words, report):
            raise RuntimeError("collalign ended without results; the reason is in the log")

    def python(self):
        """Return the path of Slicer's Python."""
        import shutil

        return shutil.which("PythonSlicer")

    def show(self, results: Results):
        """Add one model, one transform and one list of points per shape, in doubt ones in another colour."""
        for shape in results.shapes:
            transform = slicer.mrmlScene.AddNewNodeByClass(
                "vtkMRMLLinearTransformNode", f"{shape.name} to common"
            )
            transform.SetMatrixTransformToParent(_vtk_matrix(shape.transform))
            if shape.mesh is not None:
                model = slicer.util.loadModel(str(shape.mesh))
                model.SetName(shape.name)
                model.GetDisplayNode().SetColor(*(DOUBTED if shape.in_doubt else SURE))
            points = slicer.mrmlScene.AddNewNodeByClass(
                "vtkMRMLMarkupsFiducialNode", f"{shape.name} points"
            )
            slicer.util.updateMarkupsControlPointsFromArray(points, shape.points)
            points.SetLocked(True)
            points.GetDisplayNode().SetVisibility(False)
            points.SetAttribute("collalign.confidence", shape.percent)


class CollalignTest(ScriptedLoadableModuleTest):
    """The self test that Slicer runs."""

    def runTest(self):
        """Run every test on an empty scene."""
        slicer.mrmlScene.Clear()
        self.test_matrices_arrive_as_they_are()

    def test_matrices_arrive_as_they_are(self):
        """A matrix keeps its rows on the way to VTK."""
        import numpy as np

        matrix = _vtk_matrix(np.arange(16.0).reshape(4, 4))
        assert matrix.GetElement(1, 2) == 6.0


def _folder_choice(hint):
    widget = ctk.ctkPathLineEdit()
    widget.filters = ctk.ctkPathLineEdit.Dirs
    widget.setToolTip(hint)
    return widget


def _vtk_matrix(values):
    matrix = vtk.vtkMatrix4x4()
    matrix.DeepCopy(values.ravel().tolist())
    return matrix
