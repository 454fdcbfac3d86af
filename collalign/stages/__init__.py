"""One public function per step of an alignment.

* ``posing``, ``steps``: the order of the steps; what each consists of
* ``shape_stage``: files to samples, and the chirality of each surface
* ``self_symmetry``: turns and mirror images after which a shape looks like itself
* ``own_knowledge``: descriptors, samples and poses that a caller gives
* ``pieces``: which pieces of a shape are matched, its largest one or all, as its pairs would have it
* ``choose_pairs``, ``match_pairs``: which pairs; their candidates
* ``mixed_sides``: whether left and right specimens are mixed, and notes that say what the poses say of it
* ``incomplete``: shapes of which parts are missing, and scans
* ``extra_material``: stands and the like, and poses without them
* ``proofs``: of the pairs' poses
* ``evidence``: non-rigid maps assess poses
* ``kinds``: which kinds a folder holds, and how they are rotated to each other
* ``poses``: from pairs to one pose per shape
* ``trust``: the evidence of the confidence
* ``deformation``, ``deformation_jobs``: maps of all vertices, and their jobs
* ``forecast``: of times

The way of a pair. ``collalign/align.py`` is the driver. One object goes through the steps, filled with ``replace``.

* **Kinds.** ``kinds`` tells the kinds of a mixed folder apart. Each goes through all that follows by itself.
* **Shapes.** ``prepare_shapes`` reads, samples and embeds, and describes the neighbourhoods of each surface
  (``LocalSurface``). Where sides are asked for, it finds which way each surface turns as well. The product is
  ``Shapes``. ``pieces_that_match`` matches shapes that are assembled of components by the largest one and by all;
  their pairs say how each is read.
* **Rounds.** ``pose_all`` takes the steps below at most three times. Where most shapes have open borders,
  ``align_scans`` poses them in place of the others if they were seen from one direction each, like depth images
  (``were_seen``), or if their pairs match badly as whole shapes (``match_badly``). ``overlap_pairs`` finds what
  every two share, and ``join_scans`` poses all by the pairs that overlap, clouds that it leaves out as seen from
  behind once more. ``align_on_model`` is tried before: all but one may be scans of that one. ``find_incomplete``
  looks for incomplete shapes at the poses. Doubtful shapes with open borders are incomplete as well if they are posed
  more surely as parts (``chances_as_parts``). The others are posed again without them, and ``with_incomplete`` poses
  these on the others. Where most are open and some doubtful in the end, ``align_parts`` poses all as parts of each
  other; the surer answer is kept; whole shapes are less sure where parts contradict them. The same happens without
  material that only single shapes have, such as a stand (``extra_points``).
* **Pairs.** ``choose_pairs``, ``decide_group`` and ``match_pairs`` run in this order. A worker matches two shapes
  (``match_whole``). It assesses each candidate by energy and mismatch (``local_evidence``, ``candidate_costs``). If
  the best candidate hardly overlaps, ``proposed_rotations`` adds candidates. The stored ``PairPoses`` become the
  ``Pair``. ``grow_pairs`` adds pairs where poses are uncertain.
* **Synchronization.** ``certify_pairs`` adds bound and status. For shapes that bend, ``weigh_pairs`` adds candidates
  with log-odds. ``pair_graph`` passes the candidates to
  ``synchronize_shapes``.
* **Frame.** ``refine_poses`` and ``fix_frame`` determine the common frame.
* **Confidence.** ``with_common_match`` makes each pair an ``AlignedPair``, with choice, inlier, disagreement and the
  map at the common poses. ``labels_at_common_poses`` and ``place_and_scale`` follow. ``gather_trust`` tries
  competing poses on dense points, and ``with_trust`` states the confidences and what limits each (``limited``). If
  maps are wanted, ``weigh_doubtful_pairs`` weighs the pairs of doubtful shapes again, and the last two steps are
  repeated. ``map_vertices`` maps all vertices on request.

A new step is a function that takes products and returns them. It is called in the step of ``steps`` that it belongs
to, or is a step of its own with its line in ``posing``.
"""
