#!/bin/bash
# Refines a folder of photographs as an array job. From a shared file system:
#   sbatch --array=1-4 slurm.sh PHOTOS MODEL.onnx OUT
#   mde refine PHOTOS --prior-model MODEL.onnx -o OUT     # what is missing, and the index
#SBATCH --job-name=mde
#SBATCH --requeue
#SBATCH --cpus-per-task=1
#SBATCH --output=mde-%A_%a.log
set -euo pipefail
photographs=$1 model=$2 out=$3
# A task that was killed and requeued keeps what it has finished.
exec "${MDE:-mde}" refine "$photographs" --prior-model "$model" \
  --shard "$SLURM_ARRAY_TASK_ID/$SLURM_ARRAY_TASK_COUNT" \
  --threads "${SLURM_CPUS_PER_TASK:-1}" -o "$out"
