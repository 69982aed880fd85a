#!/bin/bash
# Scores a model on the scenes of a data set as an array job; all but the first argument are those of mde eval. From a shared file system:
#   sbatch --array=1-4 slurm_eval.sh OUT SUNRGBD --dataset sunrgbd --prior-model MODEL.onnx
#   mde eval SUNRGBD --dataset sunrgbd --prior-model MODEL.onnx -o OUT     # what is missing, and the tables
#SBATCH --job-name=mde-eval
#SBATCH --requeue
#SBATCH --cpus-per-task=1
#SBATCH --output=mde-eval-%A_%a.log
set -euo pipefail
out=$1
shift
# A task that was killed and requeued keeps the scenes that it has finished.
exec "${MDE:-mde}" eval "$@" \
  --shard "$SLURM_ARRAY_TASK_ID/$SLURM_ARRAY_TASK_COUNT" \
  --threads "${SLURM_CPUS_PER_TASK:-1}" -o "$out"
